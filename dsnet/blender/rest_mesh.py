"""A mesh that an armature with SMPL's joints moves, as a body model at rest. Needs no Blender.

Vertices, faces and weights are the scene's: no body file is read. Offsets need no more of a body
(`dsnet.prediction.transfer`); its shape is the mesh's, so its betas move nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData, load_body_model
from bridge.body.embedded import EMBEDDED_GENDERS, EMBEDDED_PREFIX
from bridge.body.model_data import JOINT_COUNT, POSE_FEATURE_COUNT, SMPL_PARENTS
from bridge.body.vertex_order import vertex_order
from bridge.errors import DsnetError
from bridge.motion.rest_poses import leg_length
from bridge.motion.retargeting import mean_joints
from bridge.motion.skeletons import OWN_NAMES
from bridge.paper import N_BETAS, N_JOINTS
from dsnet.blender.scene_motion import SceneArmature

_CUBE = Rotation.create_group("O")
_SNAPPED_DEG = 20.0
"""A mesh that lies so near to the scene's axes lies along them."""
_ALIKE = 0.5, 2.0
"""Leg lengths over the mean ones, of a mesh in metres."""
_AROUND = 32
"""Vertices of which a joint is made."""
_MOST_BETA = 5.0


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """A mesh of V vertices at rest, as it stands in the world."""

    name: str
    vertices: NDArray[np.float64]
    """(V, 3) with the person's shape, without pose."""
    faces: NDArray[np.int64]
    """(F, 3) triangles."""
    weights: NDArray[np.float64]
    """(V, B) of the armature's bones."""
    betas: NDArray[np.float64] | None = None
    """(10,) of an embedded body, where the file that it came from said them."""


@dataclass(frozen=True, eq=False)
class MeshBody:
    """The mesh's body model, and how the model's space lies in the world."""

    body: BodyModelData
    betas: NDArray[np.float64]
    """(10,)."""
    to_world: NDArray[np.float64]
    """(3, 3) from directions of the model, metres, y up, to the world's."""


def mesh_body(mesh: SceneMesh, armature: SceneArmature, joint_map: Mapping[str, str]) -> MeshBody:
    """The body of a mesh; DsnetError if its armature lacks some of SMPL's 22 joints."""
    bones = armature.person(joint_map).joint_map
    if missing := [name for name in OWN_NAMES if name not in bones]:
        raise DsnetError(
            f"{mesh.name}, whose armature has no {', '.join(missing)[:80]}",
            "a mesh of SMPL's family with its 22 joints",
            "Select the armature alone: a body of its own is put beside it.",
        )
    joints = [armature.bones.index(bones[name]) for name in OWN_NAMES]
    turn, scale = _placed(armature.rest[joints, :3, 3])
    to_world = turn.T / scale
    order = vertex_order(_unshaped(mesh, armature, joints, turn, scale))
    for gender in EMBEDDED_GENDERS:
        if order == _embedded_order(gender):
            return _embedded(mesh, turn, scale, to_world)
    return MeshBody(_unshaped(mesh, armature, joints, turn, scale), np.zeros(N_BETAS), to_world)


def _placed(joints: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(3, 3) that turns the world's directions to SMPL's, and metres per unit, of joints (22, 3)
    at rest."""
    own = mean_joints()
    turn, _ = Rotation.align_vectors(own - own.mean(0), joints - joints.mean(0))
    off_deg = np.degrees((_CUBE * turn.inv()).magnitude())
    if off_deg.min() < _SNAPPED_DEG:
        turn = _CUBE[int(off_deg.argmin())]
    legs, own_legs = (
        leg_length(dict(zip(OWN_NAMES, places, strict=True))) for places in (joints, own)
    )
    ratio = legs / own_legs
    scale = 1.0 if _ALIKE[0] < ratio < _ALIKE[1] else 10.0 ** -round(float(np.log10(ratio)))
    return turn.as_matrix().round(9), scale


def _unshaped(
    mesh: SceneMesh, armature: SceneArmature, joints: list[int], turn: NDArray, scale: float
) -> BodyModelData:
    """The mesh as a body with SMPL's 24 joints, the pelvis where the mean one's is."""
    places = armature.rest[joints, :3, 3] @ turn.T * scale
    shift = mean_joints()[0] - places[0]
    vertices, places = mesh.vertices @ turn.T * scale + shift, places + shift
    hands = places[SMPL_PARENTS[N_JOINTS:],]
    return BodyModelData(
        name=mesh.name,
        source="licensed",
        gender="unknown",
        v_template=vertices,
        shapedirs=np.zeros((len(vertices), 3, N_BETAS)),
        posedirs=np.zeros((len(vertices), 3, POSE_FEATURE_COUNT)),
        J_regressor=_regressor(vertices, np.concatenate([places, hands])),
        weights=_weights(mesh, armature, joints),
        faces=mesh.faces,
        parents=np.array(SMPL_PARENTS),
    )


def _weights(mesh: SceneMesh, armature: SceneArmature, joints: list[int]) -> NDArray[np.float64]:
    """(V, 24) of SMPL's joints: those of other bones, such as fingers, are the joint's above."""
    weights = np.zeros((len(mesh.vertices), JOINT_COUNT))
    for bone in range(len(armature.bones)):
        above = bone
        while above >= 0 and above not in joints:
            above = armature.parents[above]
        weights[:, joints.index(above) if above >= 0 else 0] += mesh.weights[:, bone]
    sums = weights.sum(axis=1, keepdims=True)
    if not (sums > 0).all():
        raise DsnetError(
            f"{mesh.name}, of which {np.count_nonzero(sums <= 0)} vertices follow no bone",
            "a skin with weights everywhere",
            "Give them weights, or select the armature alone.",
        )
    return weights / sums


def _regressor(vertices: NDArray[np.float64], places: NDArray[np.float64]) -> sp.csr_matrix:
    """(J, V) by which vertices (V, 3) give joints (J, 3): the least weights of those around each
    that do, and sum to 1."""
    _, around = KDTree(vertices).query(places, _AROUND)
    rows = []
    for place, near in zip(places, np.asarray(around), strict=True):
        system = np.vstack([vertices[near].T, np.ones(_AROUND)])
        rows.append(np.linalg.lstsq(system, np.append(place, 1.0), rcond=None)[0])
    row = np.repeat(np.arange(len(places)), _AROUND)
    shape = len(places), len(vertices)
    return sp.csr_matrix((np.concatenate(rows), (row, np.ravel(around))), shape=shape)


@cache
def _embedded_order(gender: str) -> str:
    return vertex_order(load_body_model(EMBEDDED_PREFIX + gender))


def _embedded(
    mesh: SceneMesh, turn: NDArray, scale: float, to_world: NDArray[np.float64]
) -> MeshBody:
    """The embedded body whose shape the mesh has; its betas are the file's, or fitted."""
    places, found = mesh.vertices @ turn.T * scale, list[tuple[float, MeshBody]]()
    for gender in EMBEDDED_GENDERS:
        body = load_body_model(EMBEDDED_PREFIX + gender)
        shapes = body.shapedirs - body.shapedirs.mean(axis=0)
        apart = places - body.v_template
        apart = (apart - apart.mean(axis=0)).ravel()
        fitted, *_ = np.linalg.lstsq(shapes.reshape(-1, N_BETAS), apart, rcond=None)
        betas = fitted.clip(-_MOST_BETA, _MOST_BETA) if mesh.betas is None else mesh.betas
        left = float(np.square(apart - shapes.reshape(-1, N_BETAS) @ betas).sum())
        found.append((left, MeshBody(body, betas, to_world)))
    return min(found, key=lambda one: one[0])[1]
