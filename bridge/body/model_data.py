"""A body model as plain float64 arrays, and its writers in SMPL's own file formats."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
import scipy.sparse as sp

from bridge.errors import DsnetError
from bridge.paper import N_JOINTS
from bridge.runs.files import written_whole

Kind = Literal["smpl", "smplh", "smplx"]
JOINT_COUNT = 24
SHAPE_COUNT = 10
POSE_FEATURE_COUNT = 9 * (JOINT_COUNT - 1)
FACE_COUNT = 13776

# SMPL's files write the root's missing parent as -1 in an unsigned 32-bit integer.
ROOT_PARENT_IN_FILE = 2**32 - 1

# SMPL's readers ignore these; they keep a synthetic body from passing for a licensed one, and say
# where expressions begin behind shapes.
SOURCE_FIELD, GENDER_FIELD, SHAPES_FIELD = "dsnet_source", "dsnet_gender", "dsnet_shapes"
GENDERS = ("female", "male", "neutral")

# fmt: off
SMPL_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
SMPL_JOINT_NAMES = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
    "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar",
    "right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)
_FACE = ("jaw", "left_eye", "right_eye")
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
# fmt: on
_WRISTS = {"left": 20, "right": 21}
_HEAD = 15


def _skeleton(face: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """SMPL's first 22 joints, those of the face, and three of each finger, left hand first."""
    names, parents = [*SMPL_JOINT_NAMES[:N_JOINTS], *face], [*SMPL_PARENTS[:N_JOINTS]]
    parents += [_HEAD] * len(face)
    for side, wrist in _WRISTS.items():
        for finger in _FINGERS:
            parents += [wrist, len(names), len(names) + 1]
            names += [f"{side}_{finger}{knuckle}" for knuckle in (1, 2, 3)]
    return tuple(names), tuple(parents)


SKELETONS: dict[Kind, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "smpl": (SMPL_JOINT_NAMES, SMPL_PARENTS),
    "smplh": _skeleton(()),
    "smplx": _skeleton(_FACE),
}
"""Names and parents of 24, 52 and 55 joints. The first 22 are the same; SMPL's last two are whole
hands, SMPL-H's next are left fingers, SMPL-X's are jaw and eyes, with fingers from 25."""
KIND_OF_JOINTS: dict[int, Kind] = {len(names): kind for kind, (names, _) in SKELETONS.items()}
_FLOATS = ("v_template", "shapedirs", "expressiondirs", "posedirs", "weights")
HAND_COUNT = 2 * 3 * len(_FINGERS)
"""Joints of both hands of SMPL-H and SMPL-X, the last of each."""


class Texture(NamedTuple):
    """How a picture lies on a body's skin."""

    places: np.ndarray
    """(T, 2) on the picture, 0 to 1 from its lower left corner."""
    corners: np.ndarray
    """(F, 3) int64, which of them each corner of each face has."""


@dataclass(frozen=True, eq=False)
class BodyModelData:
    """Everything that Eq. 1-2 need, in metres: V vertices, F faces, J = 24, 52 or 55 joints of
    SMPL, SMPL-H or SMPL-X, S shapes.

    The paper's networks are bound to SMPL's 6890 vertices; any number, in any order, is a body.
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
    """(V, 3, S) displacement per unit of each beta, all that the file has."""
    posedirs: np.ndarray
    """(V, 3, 9 (J - 1)) displacement per unit of (R - I) of all joints but the root, flattened row
    by row."""
    J_regressor: sp.csr_matrix
    """(J, V) sparse; joints = J_regressor @ shaped vertices. Rows sum to one."""
    weights: np.ndarray
    """(V, J) skinning weights. Rows sum to one."""
    faces: np.ndarray
    """(F, 3) int64 vertex indices, counter-clockwise seen from outside."""
    parents: np.ndarray
    """(J,) int64 parent of each joint; the root's is -1."""
    expressiondirs: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    """(V, 3, E) displacement per unit of each of SMPL-X's expressions; E = 0 where there are none.
    """
    hands_mean: np.ndarray | None = None
    """(30, 3) axis-angle of relaxed fingers, where the file has it. Zero pose is flat hands: who
    stored a pose relative to this one adds it."""
    texture: Texture | None = None
    """Of the faces, where the file has it, as SMPL-X's do; other faces leave it behind."""
    notes: tuple[str, ...] = ()
    """What a user would want to know of the file, a line each."""

    def __post_init__(self) -> None:
        regressor = self.J_regressor
        if not sp.issparse(regressor):
            regressor = np.asarray(regressor, dtype=np.float64)
        object.__setattr__(self, "J_regressor", sp.csr_matrix(regressor, dtype=np.float64))
        if not self.expressiondirs.size:
            empty = np.zeros((np.size(self.v_template, 0), 3, 0))
            object.__setattr__(self, "expressiondirs", empty)
        for name in _FLOATS:
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        for name in ("faces", "parents"):
            object.__setattr__(self, name, _whole_numbers(self, name))
        if self.hands_mean is not None:
            object.__setattr__(self, "hands_mean", np.asarray(self.hands_mean, np.float64))
        if self.texture is not None and self.texture.corners.shape != self.faces.shape:
            object.__setattr__(self, "texture", None)
        _check(self)

    @property
    def kind(self) -> Kind:
        """`smpl`, `smplh` or `smplx`."""
        return KIND_OF_JOINTS[len(self.parents)]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Of all J joints."""
        return SKELETONS[self.kind][0]

    @property
    def vertex_count(self) -> int:
        """Number of vertices, V."""
        return len(self.v_template)

    @property
    def joints(self) -> np.ndarray:
        """(J, 3) joints of the mean body, metres."""
        return self.J_regressor @ self.v_template

    @property
    def joint_shapes(self) -> np.ndarray:
        """(J, 3, S) displacement of the joints per unit of each beta, metres."""
        moved = self.J_regressor @ self.shapedirs.reshape(self.vertex_count, -1)
        return moved.reshape(len(moved), *self.shapedirs.shape[1:])

    @property
    def body_weights(self) -> np.ndarray:
        """(V, 22) skinning weights of SMPL's first 22 joints: hands' are the wrists', a face's the
        head's."""
        weights = self.weights.copy()
        for joint in range(len(self.parents) - 1, N_JOINTS - 1, -1):  # fingers end first
            weights[:, self.parents[joint]] += weights[:, joint]
        return weights[:, :N_JOINTS]

    def with_shapes(self, count: int) -> BodyModelData:
        """The body with so many shapes: its first, or with others that do nothing."""
        missing = max(count - self.shapedirs.shape[2], 0)
        shapes = np.pad(self.shapedirs[..., :count], ((0, 0), (0, 0), (0, missing)))
        return replace(self, shapedirs=shapes) if shapes.shape != self.shapedirs.shape else self

    def save_smpl_npz(self, path: str | Path) -> None:
        """Write the model as `SMPL_*.npz`, `SMPLH_*.npz` or `SMPLX_*.npz`: dense arrays only."""
        fields = _smpl_fields(self)
        fields["J_regressor"] = self.J_regressor.toarray()
        with _opened_to_write(path) as file:
            np.savez_compressed(file, **fields)

    def save_smpl_pkl(self, path: str | Path) -> None:
        """Write the model as SMPL's `.pkl`: a protocol 2 pickle with a sparse regressor."""
        fields = _smpl_fields(self)
        fields["J_regressor"] = sp.csc_matrix(self.J_regressor)
        with _opened_to_write(path) as file:
            pickle.dump(fields, file, protocol=2)


def _smpl_fields(data: BodyModelData) -> dict[str, Any]:
    parents = np.where(data.parents < 0, ROOT_PARENT_IN_FILE, data.parents)
    fields = {
        "v_template": data.v_template,
        "f": data.faces.astype(np.uint32),
        "weights": data.weights,
        "shapedirs": np.concatenate([data.shapedirs, data.expressiondirs], axis=2),
        "posedirs": data.posedirs,
        "kintree_table": np.stack([parents, np.arange(len(parents))]).astype(np.uint32),
        "J": data.joints,
        "bs_style": "lbs",
        "bs_type": "lrotmin",
        SOURCE_FIELD: data.source,
        GENDER_FIELD: data.gender,
        SHAPES_FIELD: np.array(data.shapedirs.shape[2]),
    }
    if data.hands_mean is not None:
        left, right = data.hands_mean.reshape(2, -1)
        fields |= {"hands_meanl": left, "hands_meanr": right}
    if data.texture is not None:
        fields |= {"vt": data.texture.places, "ft": data.texture.corners}
    return fields


@contextmanager
def _opened_to_write(path: str | Path) -> Iterator[IO[bytes]]:
    try:
        with written_whole(Path(path)) as partial, partial.open("wb") as file:
            yield file
    except OSError as error:
        raise DsnetError(
            f"cannot write {path} ({error.strerror})",
            "a file name in an existing folder that can be written",
            "Create the folder or choose another path",
        ) from error


def _check(data: BodyModelData) -> None:
    """Shapes, finite numbers, and what arrays say of one another."""
    vertex_count = len(data.v_template) if data.v_template.ndim else 0
    joints = data.weights.shape[-1] if data.weights.ndim else 0
    if joints not in KIND_OF_JOINTS:
        counts = "24, 52 or 55 joints (SMPL, SMPL-H, SMPL-X)"
        raise _invalid(data, f"weights has shape {data.weights.shape}", counts)
    shapes = data.shapedirs.shape[-1] if data.shapedirs.ndim == 3 else 0
    expressions = data.expressiondirs.shape[-1] if data.expressiondirs.ndim else 0
    expected = {
        "v_template": (vertex_count, 3),
        "shapedirs": (vertex_count, 3, max(shapes, 1)),
        "expressiondirs": (vertex_count, 3, expressions),
        "posedirs": (vertex_count, 3, 9 * (joints - 1)),
        "J_regressor": (joints, vertex_count),
        "weights": (vertex_count, joints),
        "faces": (len(data.faces) if data.faces.ndim else 0, 3),
        "parents": (joints,),
    }
    if data.hands_mean is not None:
        expected["hands_mean"] = (HAND_COUNT, 3)
    for name, shape in expected.items():
        if (received := getattr(data, name).shape) != shape:
            raise _invalid(data, f"{name} has shape {received}", f"shape {shape}")
    arrays = {name: getattr(data, name) for name in _FLOATS}
    arrays |= {"J_regressor": data.J_regressor.data}
    arrays |= {} if data.hands_mean is None else {"hands_mean": data.hands_mean}
    for name, array in arrays.items():
        if bad := int(array.size - np.isfinite(array).sum()):
            raise _invalid(data, f"{name} has {bad} values that are NaN or infinite", "none")
    faces, parents = data.faces, tuple(data.parents.tolist())
    if faces.size and not 0 <= faces.min() <= faces.max() < vertex_count:
        indices = f"faces index vertices {faces.min()} to {faces.max()}"
        raise _invalid(data, indices, f"0 to {vertex_count - 1}")
    if parents != (known := SKELETONS[data.kind][1]):
        joint = next(joint for joint in range(joints) if parents[joint] != known[joint])
        received = f"joint {joint} has parent {parents[joint]}: another skeleton"
        raise _invalid(data, received, f"parent {known[joint]}, as in {data.kind}")
    for name in ("weights", "J_regressor"):
        sums = np.asarray(getattr(data, name).sum(axis=1)).ravel()
        if (worst := float(np.abs(sums - 1.0).max(initial=0.0))) > 1e-3:
            raise _invalid(data, f"rows of {name} miss a sum of 1 by {worst:.3g}", "sums of one")


def _whole_numbers(data: BodyModelData, name: str) -> np.ndarray:
    given = np.asarray(getattr(data, name))
    with np.errstate(invalid="ignore"):  # what NaN becomes differs between processors
        whole = given.astype(np.int64)
    if (whole != given).any():
        raise _invalid(data, f"{name} of {given.dtype} that are no indices", "whole numbers")
    return whole


def _invalid(data: BodyModelData, received: str, expected: str) -> DsnetError:
    remedy = "Use an intact SMPL model file"
    return DsnetError(f"body model {data.name}: {received}", expected, remedy)
