"""Read SMPL model files, `.npz` and `.pkl`, as their owners distribute them."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bridge.body.model_data import (
    FACE_COUNT,
    GENDER_FIELD,
    JOINT_COUNT,
    POSE_FEATURE_COUNT,
    ROOT_PARENT_IN_FILE,
    SHAPE_COUNT,
    SOURCE_FIELD,
    BodyModelData,
)
from bridge.body.person import checked_person
from bridge.body.pickle_records import MOST_BYTES, as_array
from bridge.body.safe_pickle import load_restricted, load_restricted_item
from bridge.errors import DsnetError
from bridge.paper import N_VERTICES
from bridge.runs.untrusted import (
    DAMAGE,
    NpyHeader,
    UntrustedNpz,
    damage_refused,
    open_npz,
    open_regular,
    text_of,
)

# Column counts of `weights` tell SMPL's relatives, which AMASS's readers also download.
_RELATIVES = {16: "MANO", 52: "SMPL-H", 55: "SMPL-X"}
_REMEDY = "Download the SMPL model (.npz or .pkl, 24 joints) again from smpl.is.tue.mpg.de"
_MOST_FILE_BYTES, _MOST_TEXT_BYTES = 1 << 29, 1 << 12
_TEXTS = (SOURCE_FIELD, GENDER_FIELD)
_EXPECTED_SHAPES: dict[str, tuple[int | None, ...]] = {
    "v_template": (N_VERTICES, 3),
    "f": (FACE_COUNT, 3),
    "weights": (N_VERTICES, JOINT_COUNT),
    "shapedirs": (N_VERTICES, 3, None),
    "posedirs": (N_VERTICES, 3, POSE_FEATURE_COUNT),
    "J_regressor": (JOINT_COUNT, N_VERTICES),
    "kintree_table": (2, JOINT_COUNT),
}


def load_smpl_file(path: str | Path) -> BodyModelData:
    """Read an SMPL model; nothing that the file contains is executed.

    Shape components beyond the first 10 are dropped. Chumpy is not needed.

    Raises
    ------
    DsnetError
        If the file is missing, damaged, unsafe, not SMPL's, or no person in metres.
    """
    path = Path(path)
    fields = _read_fields(path)
    arrays = {name: _numeric_array(path, fields, name) for name in _EXPECTED_SHAPES}
    _check_is_smpl(path, arrays["weights"])
    for name, shape in _EXPECTED_SHAPES.items():
        _check_shape(path, name, arrays[name], shape)
    for name in ("f", "kintree_table"):
        if (arrays[name] % 1 != 0).any():
            raise DsnetError(f"body model {path}: {name} has fractions", "whole numbers", _REMEDY)
    data = BodyModelData(
        name=path.name,
        source="synthetic" if _text(fields, SOURCE_FIELD) == "synthetic" else "licensed",
        gender=_text(fields, GENDER_FIELD) or _gender_of_path(path),
        v_template=arrays["v_template"],
        shapedirs=arrays["shapedirs"][:, :, :SHAPE_COUNT],
        posedirs=arrays["posedirs"],
        # SciPy has no sparse matrices of every type that NumPy has.
        J_regressor=sp.csr_matrix(arrays["J_regressor"].astype(np.float64)),
        weights=arrays["weights"],
        faces=arrays["f"],
        parents=_parents(arrays["kintree_table"]),
    )
    return checked_person(data)


def _read_fields(path: Path) -> Mapping[str, Any]:
    read = {".npz": _read_npz, ".pkl": _read_pickle}.get(path.suffix.lower(), _read_nothing)
    with damage_refused(partial(_unreadable, path), RecursionError):
        return read(path)


def _read_nothing(path: Path) -> dict[str, Any]:
    with open_regular(path):
        kind = path.suffix or "unknown"
    raise DsnetError(f"body model {path}: a file of type {kind}", ".npz or .pkl", _REMEDY)


def _read_npz(path: Path) -> dict[str, Any]:
    with open_npz(path, _MOST_FILE_BYTES) as archive:
        there = [name for name in (*_EXPECTED_SHAPES, *_TEXTS) if name in archive]
        numeric = [name for name in there if not archive[name].dtype.hasobject]
        for name in numeric:  # all, before any is read
            archive.check(name, MOST_BYTES if name in _EXPECTED_SHAPES else _MOST_TEXT_BYTES)
        return {
            name: archive.array(name) if name in numeric else _read_object(archive, name)
            for name in there
        }


def _read_object(archive: UntrustedNpz, name: str) -> Any:
    """What NumPy stored as an array of one object, which is a pickle."""
    with archive.member(name) as stream:
        NpyHeader.read(stream)
        return load_restricted_item(stream)


def _read_pickle(path: Path) -> dict[str, Any]:
    with open_regular(path, _MOST_FILE_BYTES) as file:
        fields = load_restricted(file)
    if not isinstance(fields, dict):
        raise pickle.UnpicklingError(f"it holds a {type(fields).__name__}, not a dictionary")
    return {
        name.decode("latin1") if isinstance(name, bytes) else str(name): value
        for name, value in fields.items()
    }


def _numeric_array(path: Path, fields: Mapping[str, Any], name: str) -> np.ndarray:
    if name not in fields:
        raise DsnetError(f"body model {path}: no field {name!r}", "all of SMPL's fields", _REMEDY)
    with damage_refused(partial(_unreadable, path), RecursionError):
        array = as_array(fields[name])
        if array.dtype.kind not in "iuf":
            raise TypeError(f"field {name} is not numeric but {array.dtype}")
        return array


def _check_is_smpl(path: Path, weights: np.ndarray) -> None:
    if relative := _RELATIVES.get(weights.shape[-1] if weights.ndim else 0):
        raise DsnetError(f"body model {path}: {relative}'s", "SMPL's own", _REMEDY)


def _check_shape(path: Path, name: str, array: np.ndarray, shape: tuple[int | None, ...]) -> None:
    matches = array.ndim == len(shape) and all(
        wanted in (None, size) for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not matches or (name == "shapedirs" and array.shape[2] < SHAPE_COUNT):
        expected = tuple(f">= {SHAPE_COUNT}" if size is None else size for size in shape)
        text = ", ".join(map(str, expected))
        raise DsnetError(
            f"body model {path}: {name} has shape {array.shape}", f"shape ({text})", _REMEDY
        )


def _parents(kintree_table: np.ndarray) -> np.ndarray:
    parents = kintree_table[0].astype(np.int64)
    return np.where((parents == ROOT_PARENT_IN_FILE) | (parents < 0), -1, parents)


def _gender_of_path(path: Path) -> str:
    """SMPL's files do not say it: `SMPL_FEMALE`, `basicmodel_m_lbs_10_207_0`, `male/model`."""
    words = path.stem.lower().replace("-", "_").split("_")
    folder = path.absolute().parent.name.lower()
    genders = ("female", "male", "neutral")
    marked = (gender for gender in genders if gender in words or gender[0] in words)
    return next(marked, folder if folder in genders else "unknown")


def _text(fields: Mapping[str, Any], name: str) -> str:
    """A field's text; empty where it holds anything else."""
    value = fields.get(name, "")
    try:
        return text_of(np.asarray(value) if isinstance(value, (str, bytes)) else as_array(value))
    except DAMAGE:
        return ""


def _unreadable(path: Path, error: Exception) -> DsnetError:
    if isinstance(error, (FileNotFoundError, IsADirectoryError)):
        kind = "a folder" if isinstance(error, IsADirectoryError) else "no such file"
        return DsnetError(
            f"body model {path}: {kind}",
            "an SMPL model file (.npz or .pkl), embedded:female or embedded:male",
            "Check the path",
        )
    detail = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return DsnetError(
        f"body model {path}: cannot be read safely ({detail[:200]})",
        "an intact SMPL model file",
        _REMEDY,
    )
