"""Read SMPL's model files, `.npz` and `.pkl`, and DMPL's directions, as their owners distribute
them; what is no person's body in metres, or no closed surface, is refused."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bridge.body.model_data import (
    FACE_COUNT,
    GENDER_FIELD,
    JOINT_COUNT,
    POSE_FEATURE_COUNT,
    ROOT_PARENT_IN_FILE,
    SHAPE_COUNT,
    SMPL_JOINT_NAMES,
    SOURCE_FIELD,
    BodyModelData,
)
from bridge.body.safe_pickle import MOST_BYTES, as_array, load_restricted, load_restricted_item
from bridge.errors import DsnetError
from bridge.paper import DMPL_DIRECTIONS, N_VERTICES
from bridge.runs.untrusted import DAMAGE, NpyHeader, damage_refused, open_npz, open_regular, text_of

# Column counts of `weights` tell SMPL's relatives, which AMASS's readers also download.
_RELATIVES = {16: "MANO", 52: "SMPL-H", 55: "SMPL-X"}
_REMEDY = "Download the SMPL model (.npz or .pkl, 24 joints) again from smpl.is.tue.mpg.de"
_DMPL_REMEDY = "Download DMPL (dmpls/<gender>/model.npz) again from smpl.is.tue.mpg.de."
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
_HEIGHT_M = (1.0, 2.5)
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 1 / 0.0254}
_LARGEST_BLEND_M = 2.0
"""What one beta, or one entry of R - I, may move a vertex by."""
_JOINT_OUTSIDE_M = 0.1
_WEIGHTS = (-0.01, 1.01)
_LEFT, _RIGHT = (SMPL_JOINT_NAMES.index(f"{side}_shoulder") for side in ("left", "right"))


def _refused(name: str | Path, received: str, expected: str, remedy: str = _REMEDY) -> DsnetError:
    return DsnetError(f"body model {name}: {received}", expected, remedy)


def load_smpl_file(path: str | Path) -> BodyModelData:
    """Read an SMPL model; nothing that the file contains is executed.

    Shape components beyond the first 10 are dropped. Chumpy is not needed.

    Raises
    ------
    DsnetError
        If the file is missing, damaged, unsafe, not SMPL's, or no person in metres.
    """
    path = Path(path)
    with damage_refused(partial(_unreadable, path), RecursionError):
        fields = _read_fields(path)
    arrays = {name: _numeric_array(path, fields, name) for name in _EXPECTED_SHAPES}
    weights = arrays["weights"]
    if relative := _RELATIVES.get(weights.shape[-1] if weights.ndim else 0):
        raise _refused(path, f"{relative}'s", "SMPL's own")
    for name, shape in _EXPECTED_SHAPES.items():
        found = arrays[name].shape
        fits = len(found) == len(shape) and all(
            size == wanted or (wanted is None and size >= SHAPE_COUNT)
            for size, wanted in zip(found, shape, strict=True)
        )
        if not fits:
            text = ", ".join(str(size or f">= {SHAPE_COUNT}") for size in shape)
            raise _refused(path, f"{name} has shape {found}", f"shape ({text})")
    for name in ("f", "kintree_table"):
        if (arrays[name] % 1 != 0).any():
            raise _refused(path, f"{name} has fractions", "whole numbers")
    parents = arrays["kintree_table"][0].astype(np.int64)
    data = BodyModelData(
        name=path.name,
        source="synthetic" if _text(fields, SOURCE_FIELD) == "synthetic" else "licensed",
        gender=_text(fields, GENDER_FIELD) or _gender_of_path(path),
        v_template=arrays["v_template"],
        shapedirs=arrays["shapedirs"][:, :, :SHAPE_COUNT],
        posedirs=arrays["posedirs"],
        # SciPy has no sparse matrices of every type that NumPy has.
        J_regressor=sp.csr_matrix(arrays["J_regressor"].astype(np.float64)),
        weights=weights,
        faces=arrays["f"],
        parents=np.where((parents == ROOT_PARENT_IN_FILE) | (parents < 0), -1, parents),
    )
    return checked_person(data)


def _read_fields(path: Path) -> Mapping[str, Any]:
    kind = path.suffix.lower()
    if kind == ".npz":
        return _read_npz(path)
    with open_regular(path, _MOST_FILE_BYTES) as file:
        if kind != ".pkl":
            raise _refused(path, f"a file of type {path.suffix or 'unknown'}", ".npz or .pkl")
        fields = load_restricted(file)
    if not isinstance(fields, dict):
        raise pickle.UnpicklingError(f"it holds a {type(fields).__name__}, not a dictionary")
    return {
        name.decode("latin1") if isinstance(name, bytes) else str(name): value
        for name, value in fields.items()
    }


def _read_npz(path: Path) -> dict[str, Any]:
    with open_npz(path, _MOST_FILE_BYTES) as archive:
        there = [name for name in (*_EXPECTED_SHAPES, *_TEXTS) if name in archive]
        pickled = {name for name in there if archive[name].dtype.hasobject}
        for name in there:  # all, before any is read
            if name not in pickled:
                archive.check(name, MOST_BYTES if name in _EXPECTED_SHAPES else _MOST_TEXT_BYTES)
        fields = {name: archive.array(name) for name in there if name not in pickled}
        for name in pickled:
            with archive.member(name) as stream:
                NpyHeader.read(stream)
                fields[name] = load_restricted_item(stream)
        return fields


def _numeric_array(path: Path, fields: Mapping[str, Any], name: str) -> np.ndarray:
    if name not in fields:
        raise _refused(path, f"no field {name!r}", "all of SMPL's fields")
    with damage_refused(partial(_unreadable, path), RecursionError):
        array = as_array(fields[name])
        if array.dtype.kind not in "iuf":
            raise TypeError(f"field {name} is not numeric but {array.dtype}")
        return array


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
        expected = "an SMPL model file (.npz or .pkl), embedded:female or embedded:male"
        return _refused(path, kind, expected, "Check the path")
    detail = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return _refused(path, f"cannot be read safely ({detail[:200]})", "an intact SMPL model file")


def checked_person(data: BodyModelData) -> BodyModelData:
    """The model itself, if its mean body is a person in metres: y up, +x the body's left."""
    refused = partial(_refused, data.name, remedy="Use an intact SMPL model file")
    size, template = np.ptp(data.v_template, axis=0), data.v_template
    largest = size.max()
    if not _HEIGHT_M[0] < largest < _HEIGHT_M[1]:
        units = (u for u, per_m in _UNITS.items() if _HEIGHT_M[0] < largest / per_m < _HEIGHT_M[1])
        unit = next(units, None)
        remedy = f"It seems to be in {unit}: divide v_template, shapedirs and posedirs by it"
        remedy = remedy if unit else "Convert it to metres"
        raise refused(f"a body of {largest:.4g}", "a person in metres", remedy=remedy)
    if size[2] > min(size[:2]):
        measures = " x ".join(f"{side:.2f}" for side in size)
        turn = "Turn it (from z up: (x, y, z) to (x, z, -y))"
        raise refused(f"a body of {measures} m (x, y, z)", "y up, facing z", remedy=turn)
    if data.joints[_LEFT, 0] <= data.joints[_RIGHT, 0]:
        flaw = "a body whose left shoulder is not at +x of its right one"
        turn = "It is mirrored or faces -z: turn it"
        raise refused(flaw, "+x the body's left", remedy=turn)
    low, high = data.weights.min(), data.weights.max()
    if low < _WEIGHTS[0] or high > _WEIGHTS[1]:
        raise refused(f"skinning weights of {low:.3g} to {high:.3g}", "0 to 1")
    far = np.abs(data.joints - np.clip(data.joints, template.min(0), template.max(0)))
    if far.max() > _JOINT_OUTSIDE_M:
        raise refused(f"a joint {far.max():.3g} m outside of the body", "joints inside")
    for field in ("shapedirs", "posedirs"):
        if (moved := np.abs(getattr(data, field)).max()) > _LARGEST_BLEND_M:
            bound = f"at most {_LARGEST_BLEND_M:g} m"
            raise refused(f"{field} that move a vertex by {moved:.3g} m", bound)
    return data


def checked_surface(data: BodyModelData) -> BodyModelData:
    """The model itself, if its faces are one closed surface, counter-clockwise from outside."""
    # It takes half a second to import: more than the first frames of an embedded body.
    import trimesh

    mesh = trimesh.Trimesh(data.v_template, data.faces, process=False)
    repeated = (np.diff(np.sort(data.faces, axis=1), axis=1) == 0).any(axis=1).sum()
    if repeated:
        flaw = f"{repeated} faces that repeat a vertex"
    elif not mesh.is_watertight:
        flaw = "faces that leave holes"
    elif not mesh.is_winding_consistent:
        flaw = "neighbouring faces that wind in opposite directions"
    elif mesh.body_count != 1:
        flaw = f"faces in {mesh.body_count} pieces"
    elif mesh.volume <= 0:
        flaw = "faces that wind clockwise seen from outside"
    else:
        return data
    closed = "one closed surface, wound counter-clockwise seen from outside"
    raise _refused(data.name, flaw, closed, "Use an intact SMPL model file")


def load_dmpl_directions(path: str | Path) -> NDArray[np.float64]:
    """The first 8 directions (6890, 3, 8) in which a soft body moves, of DMPL's
    `dmpls/<gender>/model.npz`."""

    def refusal(error: Exception | str) -> DsnetError:
        detail = "no 'eigvec'" if isinstance(error, KeyError) else str(error)[:200]
        shape = f"({N_VERTICES}, 3, {DMPL_DIRECTIONS} or more)"
        expected = f"`eigvec` {shape} of directions that are not parallel"
        return DsnetError(f"DMPL {path}: {detail}", expected, _DMPL_REMEDY)

    with damage_refused(refusal), open_npz(path, _MOST_FILE_BYTES) as archive:
        archive.check("eigvec", MOST_BYTES)
        found = archive.array("eigvec")
    fits = found.shape[:2] == (N_VERTICES, 3) and found.ndim == 3 and found.dtype.kind in "iuf"
    if not fits or found.shape[2] < DMPL_DIRECTIONS:
        raise refusal(f"eigvec of {found.dtype} in shape {found.shape}")
    directions = found[..., :DMPL_DIRECTIONS].astype(np.float64)
    columns = directions.reshape(-1, DMPL_DIRECTIONS)
    if not np.isfinite(columns).all() or np.linalg.matrix_rank(columns) < DMPL_DIRECTIONS:
        raise refusal("directions that are parallel, or not numbers")
    return directions
