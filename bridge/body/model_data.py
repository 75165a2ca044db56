"""A body model as plain float64 arrays, and its writers in SMPL's own file formats."""

from __future__ import annotations

import os
import pickle
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
import scipy.sparse as sp

from bridge.errors import DsnetError

JOINT_COUNT = 24
SHAPE_COUNT = 10
POSE_FEATURE_COUNT = 9 * (JOINT_COUNT - 1)
FACE_COUNT = 13776

# SMPL's files write the root's missing parent as -1 in an unsigned 32-bit integer.
ROOT_PARENT_IN_FILE = 2**32 - 1

# SMPL's readers ignore these; they keep a synthetic body from passing for a licensed one.
SOURCE_FIELD, GENDER_FIELD = "dsnet_source", "dsnet_gender"

# fmt: off
SMPL_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
SMPL_JOINT_NAMES = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
    "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar",
    "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)
# fmt: on


@dataclass(frozen=True, eq=False)
class BodyModelData:
    """Everything that Eq. 1-2 need, in metres; V = 6890 and F = 13776 for SMPL.

    Other vertex and face counts are accepted, so that tests can use small bodies; the file
    readers insist on SMPL's.
    """

    name: str
    """Where the model came from: `embedded:female` or a file's name."""
    source: Literal["synthetic", "licensed"]
    """`synthetic` for the embedded bodies; carried into every artifact made from the model."""
    gender: str
    """`female`, `male`, `neutral` or `unknown`."""
    v_template: np.ndarray
    """(V, 3) mean body in the T-pose, y up, z forward, +x the body's left."""
    shapedirs: np.ndarray
    """(V, 3, 10) displacement per unit of each beta."""
    posedirs: np.ndarray
    """(V, 3, 207) displacement per unit of (R - I) of joints 1..23, flattened row by row."""
    J_regressor: sp.csr_matrix
    """(24, V) sparse; joints = J_regressor @ shaped vertices. Rows sum to one."""
    weights: np.ndarray
    """(V, 24) skinning weights. Rows sum to one."""
    faces: np.ndarray
    """(F, 3) int64 vertex indices, counter-clockwise seen from outside."""
    parents: np.ndarray
    """(24,) int64 parent of each joint; the root's is -1."""

    def __post_init__(self) -> None:
        regressor = self.J_regressor
        if not sp.issparse(regressor):
            regressor = np.asarray(regressor, dtype=np.float64)
        object.__setattr__(self, "J_regressor", sp.csr_matrix(regressor, dtype=np.float64))
        for field in ("v_template", "shapedirs", "posedirs", "weights"):
            object.__setattr__(self, field, np.asarray(getattr(self, field), dtype=np.float64))
        for field in ("faces", "parents"):
            object.__setattr__(self, field, _whole_numbers(self, field))
        _check(self)

    @property
    def vertex_count(self) -> int:
        """Number of vertices, V."""
        return len(self.v_template)

    @property
    def joints(self) -> np.ndarray:
        """(24, 3) joints of the mean body, metres."""
        return self.J_regressor @ self.v_template

    def save_smpl_npz(self, path: str | Path) -> None:
        """Write the model as SMPL's `SMPL_*.npz`: dense arrays only."""
        fields = _smpl_fields(self)
        fields["J_regressor"] = self.J_regressor.toarray()
        _write_atomically(path, lambda file: np.savez_compressed(file, **fields))

    def save_smpl_pkl(self, path: str | Path) -> None:
        """Write the model as SMPL's `.pkl`: a protocol 2 pickle with a sparse regressor."""
        fields = _smpl_fields(self)
        fields["J_regressor"] = sp.csc_matrix(self.J_regressor)
        _write_atomically(path, lambda file: pickle.dump(fields, file, protocol=2))


def _smpl_fields(data: BodyModelData) -> dict[str, Any]:
    joint_index = np.arange(JOINT_COUNT)
    parents = np.where(data.parents < 0, ROOT_PARENT_IN_FILE, data.parents)
    return {
        "v_template": data.v_template,
        "f": data.faces.astype(np.uint32),
        "weights": data.weights,
        "shapedirs": data.shapedirs,
        "posedirs": data.posedirs,
        "kintree_table": np.stack([parents, joint_index]).astype(np.uint32),
        "J": data.joints,
        "bs_style": "lbs",
        "bs_type": "lrotmin",
        SOURCE_FIELD: data.source,
        GENDER_FIELD: data.gender,
    }


def _write_atomically(path: str | Path, write: Callable[[IO[bytes]], None]) -> None:
    """Write beside `path` and rename into place, so that no reader meets half a file."""
    path = Path(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            temporary = Path(folder) / path.name
            with temporary.open("wb") as file:
                write(file)
            os.replace(temporary, path)
    except OSError as error:
        raise DsnetError(
            f"cannot write {path} ({error.strerror})",
            "a file name in an existing folder that can be written",
            "Create the folder or choose another path",
        ) from error


def _check(data: BodyModelData) -> None:
    """Shapes, finite numbers, and what arrays say of one another."""
    vertex_count = len(data.v_template) if data.v_template.ndim else 0
    expected = {
        "v_template": (vertex_count, 3),
        "shapedirs": (vertex_count, 3, SHAPE_COUNT),
        "posedirs": (vertex_count, 3, POSE_FEATURE_COUNT),
        "J_regressor": (JOINT_COUNT, vertex_count),
        "weights": (vertex_count, JOINT_COUNT),
        "faces": (len(data.faces) if data.faces.ndim else 0, 3),
        "parents": (JOINT_COUNT,),
    }
    for field, shape in expected.items():
        if (received := getattr(data, field).shape) != shape:
            raise _invalid(data, f"{field} has shape {received}", f"shape {shape}")
    arrays = {field: getattr(data, field) for field in ("v_template", "shapedirs", "weights")}
    arrays |= {"posedirs": data.posedirs, "J_regressor": data.J_regressor.data}
    for field, array in arrays.items():
        if bad := int(array.size - np.isfinite(array).sum()):
            raise _invalid(data, f"{field} has {bad} values that are NaN or infinite", "none")
    faces, (root, *others) = data.faces, data.parents.tolist()
    if faces.size and not 0 <= faces.min() <= faces.max() < vertex_count:
        indices = f"faces index vertices {faces.min()} to {faces.max()}"
        raise _invalid(data, indices, f"0 to {vertex_count - 1}")
    if root != -1 or not all(0 <= parent < joint for joint, parent in enumerate(others, 1)):
        found = f"parents are {data.parents.tolist()}"
        raise _invalid(data, found, "-1 first, then only earlier joints")
    for field in ("weights", "J_regressor"):
        sums = np.asarray(getattr(data, field).sum(axis=1)).ravel()
        if (worst := float(np.abs(sums - 1.0).max(initial=0.0))) > 1e-3:
            raise _invalid(data, f"rows of {field} miss a sum of 1 by {worst:.3g}", "sums of one")


def _whole_numbers(data: BodyModelData, field: str) -> np.ndarray:
    given = np.asarray(getattr(data, field))
    with np.errstate(invalid="ignore"):  # what NaN becomes differs between processors
        whole = given.astype(np.int64)
    if (whole != given).any():
        raise _invalid(data, f"{field} of {given.dtype} that are no indices", "whole numbers")
    return whole


def _invalid(data: BodyModelData, received: str, expected: str) -> DsnetError:
    remedy = "Use an intact SMPL model file"
    return DsnetError(f"body model {data.name}: {received}", expected, remedy)
