"""Read body model files of SMPL, SMPL-H and SMPL-X as their owners distribute them and others save
them again: fields by any of their names, arrays in any of their layouts.

What is another model, a motion, or no person in metres, is refused by name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from safetensors import SafetensorError

from bridge.body.body_checks import checked_person, checked_surface
from bridge.body.containers import MODELS, TEXTURE, read_fields, refused
from bridge.body.model_data import (
    GENDER_FIELD,
    GENDERS,
    HAND_COUNT,
    KIND_OF_JOINTS,
    SHAPES_FIELD,
    SOURCE_FIELD,
    BodyModelData,
    Texture,
)
from bridge.body.pickled_arrays import MOST_BYTES, Record, as_array
from bridge.errors import DsnetError
from bridge.runs.untrusted import DAMAGE, damage_refused, text_of


class _Field(NamedTuple):
    names: tuple[str, ...]
    """In files, and as buffers of smplx's PyTorch module."""
    shape: str
    """V vertices, J joints, P = 9 (J - 1), any other letter what there is."""
    needed: bool = True


_FIELDS = {
    "v_template": _Field(("v_template",), "V3"),
    "weights": _Field(("weights", "lbs_weights"), "VJ"),
    "f": _Field(("f", "faces_tensor", "faces"), "F3"),
    "shapedirs": _Field(("shapedirs",), "V3S"),
    "posedirs": _Field(("posedirs",), "V3P"),
    "J_regressor": _Field(("J_regressor",), "JV"),
    "kintree_table": _Field(("kintree_table", "parents"), "2J"),
    "expr_dirs": _Field(("expr_dirs", "exprdirs"), "V3E", needed=False),
    "hands_meanl": _Field(("hands_meanl", "left_hand_mean"), "H", needed=False),
    "hands_meanr": _Field(("hands_meanr", "right_hand_mean"), "H", needed=False),
    SHAPES_FIELD: _Field((SHAPES_FIELD,), "", needed=False),
}
_OF_EXPRESSIONS = re.compile(r"expr|exp_?dirs|face\w*dirs", re.IGNORECASE)
"""What names of other fields have in them that are a model's expressions, if their sizes fit."""
_WANTED = {name: MOST_BYTES for field in _FIELDS.values() for name in field.names}
_WANTED |= {SOURCE_FIELD: 1 << 12, GENDER_FIELD: 1 << 12} | dict.fromkeys(TEXTURE, MOST_BYTES)
_BY_FIELD: dict[str, tuple[str, str]] = {
    "eigvec": ("DMPL's directions of soft tissue", "Pass it to --dmpl"),
    "skin_template_v": ("SKEL's, another skeleton", MODELS),
    "vertices_template": ("SMPL++'s, with vertices_template and other names, faces from 1",
                          "Pass the file that it was made from"),
    "hands_components": ("MANO's, a hand", MODELS),
    **dict.fromkeys(("components", "componentsl"), ("a prior of hands' poses", MODELS)),
    **dict.fromkeys(
        (
            "poses", "fullpose", "pose_body", "body_pose", "pose", "smpl_poses", "pose_world",
            "smpl_params_global", "trans",
        ),
        ("a motion", "Pass it to --motion"),
    ),
}  # fmt: skip
"""What a file is that has such a field, and no model's."""
_BY_JOINTS = {
    5: "FLAME's, a head", 16: "MANO's, a hand", 33: "SMAL's, an animal",
    35: "SMAL's, an animal", 36: "SMAL's, an animal", 75: "SUPR's",
}  # fmt: skip
_BY_POSEDIRS = {93: "STAR's, which poses otherwise"}
_LAYOUTS = {20: 10, 400: 300}
"""Of the owners' SMPL-X files, which do not say it: shapes before expressions, in one array; other
counts are ambiguous."""
_SURELY_SHAPES = 10


def load_smpl_file(path: str | Path) -> BodyModelData:
    """Read a model of SMPL, SMPL-H or SMPL-X; nothing that the file contains is executed.

    Raises
    ------
    DsnetError
        If the file is missing, damaged, unsafe, another model's, or no person in metres.
    """
    path = Path(path)
    safely = partial(damage_refused, partial(_unreadable, path), RecursionError, SafetensorError)
    with safely():
        fields = _by_smpl_names(read_fields(path, _WANTED))
        if "v_template" in fields and "expr_dirs" not in fields:
            fields |= _expressions_of_other_names(path, fields)
    _check_what_it_is(path, fields)
    with safely():
        arrays = {name: _numbers(name, fields[name]) for name in _FIELDS if name in fields}
    body = _in_layout(path, arrays)
    data = _body(path, body, fields)
    return checked_surface(checked_person(data))


def _by_smpl_names(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields under the first of their names; of a checkpoint, whatever module they lie in."""
    if "v_template" not in fields:
        inner = (one for one in fields.values() if isinstance(one, dict) and "v_template" in one)
        fields = next(inner, None) or {n.rpartition(".")[2]: v for n, v in fields.items()}
    named = {str(name): value for name, value in fields.items()}
    for smpl_name, field in _FIELDS.items():
        for name in field.names[1:]:
            if smpl_name not in named and name in named:
                named[smpl_name] = named[name]
    return named


def _expressions_of_other_names(path: Path, fields: Mapping[str, Any]) -> dict[str, Any]:
    size = as_array(fields["v_template"]).size
    for name in filter(_OF_EXPRESSIONS.search, fields):
        value = fields[name]
        if value is None:  # of an .npz, of which only what is wanted is read
            value = read_fields(path, {name: MOST_BYTES})[name]
        array = as_array(value) if isinstance(value, (np.ndarray, Record)) else np.empty(0)
        if array.size and array.size % size == 0 and array.dtype.kind == "f":
            return {"expr_dirs": array}
    return {}


def _check_what_it_is(path: Path, fields: Mapping[str, Any]) -> None:
    missing = [name for name, field in _FIELDS.items() if field.needed and name not in fields]
    if not missing:
        return
    inner = (one for one in fields.values() if isinstance(one, dict))
    names = {str(name) for one in (fields, *inner) for name in one}
    for name, (what, remedy) in _BY_FIELD.items():
        if name in names and "v_template" not in names:
            raise refused(path, what, remedy=remedy)
    there = ", ".join(list(fields)[:8]) or "nothing"
    raise refused(path, f"no field {missing[0]!r} (it has {there})")


def _numbers(name: str, value: Any) -> np.ndarray:
    array = as_array(value)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"field {name} is not numeric but {array.dtype}")
    if array.dtype.byteorder == ">" or array.dtype == np.float16:
        array = array.astype(np.float64)  # SciPy has no sparse matrices of every type of NumPy's
    return array


def _in_layout(path: Path, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every array in SMPL's layout, whether it was turned over or flat."""
    template, weights = arrays["v_template"], np.squeeze(arrays["weights"])
    vertices = template.size // 3
    joints = weights.shape[-1] if weights.ndim == 2 else 0
    if weights.ndim == 2 and weights.shape[0] != vertices == weights.shape[1]:
        joints = weights.shape[0]
    last = arrays["posedirs"].shape[-1] if arrays["posedirs"].ndim == 3 else 0
    if other := _BY_JOINTS.get(joints) or _BY_POSEDIRS.get(last):
        raise refused(path, f"{other} ({joints} joints)")
    if joints not in KIND_OF_JOINTS:
        found = f"weights has shape {weights.shape}: a skeleton of {joints} joints"
        raise refused(path, found, f"({vertices}, 24 or 52 or 55)")
    sizes = {"V": vertices, "3": 3, "2": 2, "J": joints, "P": 9 * (joints - 1)}
    in_layout = {}
    for name, array in arrays.items():
        shape = tuple(sizes.get(letter) for letter in _FIELDS[name].shape)
        if name == "kintree_table" and array.size == joints:  # parents alone
            shape = (joints,)
        if (fitted := _fitted(array, shape)) is None:
            text = ", ".join(str(size or "any") for size in shape)
            raise refused(path, f"{name} has shape {array.shape}", f"shape ({text})")
        in_layout[name] = fitted
    return in_layout


def _fitted(array: np.ndarray, shape: tuple[int | None, ...]) -> np.ndarray | None:
    """The array in a shape, of which one size may be open; None if it is of another."""
    if len(shape) <= 1:
        return array.ravel()
    if array.ndim > len(shape) and len(array) == 1:  # a batch of one
        return _fitted(array[0], shape)
    if any(size == 0 for size in array.shape):
        return None
    known = int(np.prod([size or 1 for size in shape], dtype=object))
    whole = tuple(size or array.size // known for size in shape)
    if np.prod(whole, dtype=object) != array.size:
        return None
    if array.shape == whole or array.ndim == 1:
        return array.reshape(whole)
    rows = (int(np.prod(whole[:-1])), whole[-1])
    if array.shape == rows:  # V 3 beside one another
        return array.reshape(whole)
    if array.shape == whole[::-1]:  # turned over, as MATLAB writes
        return np.ascontiguousarray(array.T)
    if array.shape in (rows[::-1], (whole[-1], *whole[:-1])):  # its last axis first
        return np.ascontiguousarray(np.moveaxis(array, 0, -1)).reshape(whole)
    return None


def _body(path: Path, arrays: dict[str, np.ndarray], fields: Mapping[str, Any]) -> BodyModelData:
    for name in ("f", "kintree_table"):
        if (arrays[name] % 1 != 0).any():
            raise refused(path, f"{name} has fractions", "whole numbers")
    joints, dirs = arrays["weights"].shape[1], arrays["shapedirs"]
    parents = arrays["kintree_table"].reshape(-1, joints)[0].astype(np.int64)
    parents[0] = -1  # whatever a file has there, nobody reads it
    shapes, notes = _shapes_of(path, arrays, joints)
    left, right = (arrays.get(f"hands_mean{side}") for side in "lr")
    hands = None
    if left is not None and right is not None and left.size + right.size == 3 * HAND_COUNT:
        hands = np.concatenate([left, right]).reshape(HAND_COUNT, 3)
    return BodyModelData(
        name=path.name,
        source="synthetic" if _text(fields, SOURCE_FIELD) == "synthetic" else "licensed",
        gender=_text(fields, GENDER_FIELD) or gender_in_path(path),
        v_template=arrays["v_template"],
        shapedirs=dirs[:, :, :shapes],
        posedirs=arrays["posedirs"],
        J_regressor=sp.csr_matrix(arrays["J_regressor"].astype(np.float64)),
        weights=arrays["weights"],
        faces=arrays["f"],
        parents=parents,
        expressiondirs=arrays.get("expr_dirs", dirs[:, :, shapes:]),
        hands_mean=hands,
        texture=_texture(fields, arrays["f"].shape),
        notes=notes,
    )


def _texture(fields: Mapping[str, Any], faces: tuple[int, ...]) -> Texture | None:
    """Where a file has one that fits its faces."""
    try:
        places, corners = (as_array(fields[name]).astype(np.float64) for name in TEXTURE)
    except (*DAMAGE, RecursionError):
        return None
    if places.shape[1:] != (2,) or corners.shape != faces or not np.isfinite(places).all():
        return None
    known = np.isin(corners, np.arange(len(places))).all()
    return Texture(places, corners.astype(np.int64)) if known else None


def _shapes_of(
    path: Path, arrays: Mapping[str, np.ndarray], joints: int
) -> tuple[int, tuple[str, ...]]:
    """How many columns of `shapedirs` are shapes, and a note where that is ambiguous."""
    columns = arrays["shapedirs"].shape[2]
    if SHAPES_FIELD in arrays and arrays[SHAPES_FIELD].size == 1:
        return min(max(int(arrays[SHAPES_FIELD].item()), 1), columns), ()
    if "expr_dirs" in arrays:
        expressions = arrays["expr_dirs"]
        shapes = columns - expressions.shape[2]
        is_twice = shapes > 0 and np.array_equal(arrays["shapedirs"][:, :, shapes:], expressions)
        return shapes if is_twice else columns, ()
    if KIND_OF_JOINTS[joints] != "smplx" or columns <= _SURELY_SHAPES:
        return columns, ()
    if columns in _LAYOUTS:
        return _LAYOUTS[columns], ()
    which = f"{path.name} has {columns} columns of shapes and expressions, and not 10 + 10 or "
    return _SURELY_SHAPES, (f"{which}300 + 100: the first {_SURELY_SHAPES} are taken for shapes",)


def gender_in_path(path: Path) -> str:
    """SMPL's files do not say it: `SMPL_FEMALE`, `basicmodel_m_lbs_10_207_0`, `male/model`."""
    words = path.stem.lower().replace("-", "_").split("_")
    folder = path.absolute().parent.name.lower()
    marked = (gender for gender in GENDERS if gender in words or gender[0] in words)
    return next(marked, folder if folder in GENDERS else "unknown")


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
        expected = "a model file (.npz or .pkl), embedded:female or embedded:male"
        return refused(path, kind, expected, "Check the path")
    detail = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    cut = "ends early" in detail
    return refused(
        path,
        f"{'cut short: it ' if cut else ''}cannot be read safely ({detail[:200]})",
        "an intact model file",
        "Download the file again" if cut else "Pass the model file as its owners distribute it",
    )
