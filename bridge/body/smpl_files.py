"""Read SMPL model files, `.npz` and `.pkl`, as their owners distribute them."""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Mapping
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
from bridge.body.safe_pickle import as_array, load_restricted
from bridge.errors import DsnetError
from bridge.paper import N_VERTICES

# Column counts of `weights` tell SMPL's relatives, which AMASS's readers also download.
_RELATIVES = {16: "MANO", 52: "SMPL-H", 55: "SMPL-X"}
_REMEDY = "Download the SMPL model (.npz or .pkl, 24 joints) again from smpl.is.tue.mpg.de"
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
        If the file is missing, damaged, unsafe, or not SMPL's.
    """
    path = Path(path)
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "no such file"
        raise DsnetError(
            f"body model {path}: {kind}",
            "an SMPL model file (.npz or .pkl), embedded:female or embedded:male",
            "Check the path",
        )
    fields = _read_fields(path)
    arrays = {name: _numeric_array(path, fields, name) for name in _EXPECTED_SHAPES}
    _check_is_smpl(path, arrays["weights"])
    for name, shape in _EXPECTED_SHAPES.items():
        _check_shape(path, name, arrays[name], shape)
    return BodyModelData(
        name=path.name,
        source="synthetic" if _text(fields, SOURCE_FIELD) == "synthetic" else "licensed",
        gender=_text(fields, GENDER_FIELD) or _gender_of_path(path),
        v_template=arrays["v_template"],
        shapedirs=arrays["shapedirs"][:, :, :SHAPE_COUNT],
        posedirs=arrays["posedirs"],
        J_regressor=sp.csr_matrix(arrays["J_regressor"]),
        weights=arrays["weights"],
        faces=arrays["f"],
        parents=_parents(arrays["kintree_table"]),
    )


def _read_fields(path: Path) -> Mapping[str, Any]:
    read = {".npz": _read_npz, ".pkl": _read_pickle}.get(path.suffix.lower())
    if read is None:
        raise DsnetError(
            f"body model {path}: a file of type {path.suffix or 'unknown'}", ".npz or .pkl", _REMEDY
        )
    try:
        return read(path)
    # A damaged or hostile file can fail inside the readers in any way at all.
    except Exception as error:
        raise _unreadable(path, error) from error


def _read_npz(path: Path) -> dict[str, Any]:
    wanted = {*_EXPECTED_SHAPES, SOURCE_FIELD, GENDER_FIELD}
    with zipfile.ZipFile(path) as archive:
        names = {Path(member).stem: member for member in archive.namelist()}
        return {name: _read_npy(archive, names[name]) for name in wanted & names.keys()}


def _read_npy(archive: zipfile.ZipFile, member: str) -> Any:
    """One array; an object array (a pickle) is read by the restricted unpickler."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read_header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        dtype = read_header(file)[2]
        if dtype.hasobject:
            return load_restricted(file).item()
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _read_pickle(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        fields = load_restricted(file)
    if not isinstance(fields, dict):
        raise pickle.UnpicklingError(f"it holds a {type(fields).__name__}, not a dictionary")
    return {_as_text(name): value for name, value in fields.items()}


def _numeric_array(path: Path, fields: Mapping[str, Any], name: str) -> np.ndarray:
    if name not in fields:
        raise DsnetError(f"body model {path}: no field {name!r}", "all of SMPL's fields", _REMEDY)
    try:
        array = as_array(fields[name])
        if array.dtype.kind not in "iuf":
            raise TypeError(f"field {name} is not numeric but {array.dtype}")
        return array
    except Exception as error:
        raise _unreadable(path, error) from error


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
    return _as_text(fields.get(name, ""))


def _as_text(value: Any) -> str:
    return value.decode("latin1") if isinstance(value, bytes) else str(value)


def _unreadable(path: Path, error: Exception) -> DsnetError:
    detail = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return DsnetError(
        f"body model {path}: cannot be read safely ({detail[:200]})",
        "an intact SMPL model file",
        _REMEDY,
    )
