"""From the skeleton of a BVH file to SMPL's 22 joints.

A joint of SMPL turns in the world as the joint of the file does that has its place:

    G_j(t) = B_j(t) A_j,    local rotation = G_parent(t)^T G_j(t)

B_j is the world rotation of the file's joint from the file's rest pose, seen along SMPL's axes, and
A_j turns SMPL's rest pose (a T) into the file's, which may be an A or have hanging arms: the
shortest turn from SMPL's bone to the file's, of thighs, shins, upper arms and forearms; hands go
with forearms. Of the trunk, the head and the feet the two rest poses are taken to be alike. Joints
that the file lacks do not turn. A skeleton that is SMPL's own, by its names, is taken as it is:
A_j = I.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.motion.amass_file import StoredMotion
from bridge.motion.bounds import FARTHEST_M
from bridge.motion.bvh_file import BvhFile, unusable
from bridge.motion.joint_names import SIDES, joints_by_name, plain_name
from bridge.paper import N_BETAS, N_JOINTS

_ALIGNED = {"hip": "knee", "knee": "ankle", "shoulder": "elbow", "elbow": "wrist"}
"""Joints whose bone, to the second one, is brought from one rest pose to the other."""
_ARMS = {f"{side}_{name}" for name in ("shoulder", "elbow") for side in SIDES}
_FARTHEST_FROM_T_DEG = 75.0
_FARTHEST_ARM_DEG = 110.0
"""Of arms and forearms, which may hang at the sides; the shortest turn then has the palms there."""


def retargeted(bvh: BvhFile) -> StoredMotion:
    """The motion as SMPL's joints do it, for a body of the mean shape; z up, as AMASS has it.

    The root's path is scaled by the length of the legs, which also brings the file's unit to
    metres. The file tells neither shape nor gender.

    Raises
    ------
    DsnetError
        If the skeleton lacks a joint that a body needs, or rests neither in a T or an A nor with
        hanging arms.
    """
    joints = joints_by_name(bvh)
    smpl_rest_m = shaped_joints(load_body_model("embedded:female"), np.zeros((1, N_BETAS)))[0]
    upright = _axes(bvh, joints, smpl_rest_m)
    rest = bvh.rest @ upright.T
    scale = _leg(smpl_rest_m, dict(zip(SMPL_JOINT_NAMES, range(24), strict=True))) / _leg(
        rest, joints
    )
    aligned = _rest_alignment(bvh, joints, rest, smpl_rest_m)
    z_up = Rotation.from_euler("x", 90, degrees=True)
    pose, trans_m = np.empty((len(bvh.root), N_JOINTS, 3)), np.empty(bvh.root.shape)
    for frames, turns, places in bvh.blocks():
        world = upright @ turns @ upright.T
        pose[frames] = _local(world, joints, aligned)
        trans_m[frames] = scale * places[:, joints["pelvis"]] @ upright.T
    if (far_m := np.abs(trans_m).max()) > FARTHEST_M:
        raise unusable(bvh.path, f"that goes {far_m:.3g} m off", "Export it near the origin.")
    pose[:, 0] = (z_up * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    return StoredMotion(
        pose=pose,
        trans_m=z_up.apply(trans_m),
        betas=np.zeros(N_BETAS),
        gender="unknown",
        fps=bvh.fps,
        dmpls=None,
    )


def _axes(
    bvh: BvhFile, joints: Mapping[str, int], smpl_rest_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3, 3) from the file's axes to SMPL's: of the 24 turns of a cube the one that fits best."""
    names = list(joints)
    own = bvh.rest[[joints[name] for name in names]] - bvh.rest[joints["pelvis"]]
    smpl = smpl_rest_m[[SMPL_JOINT_NAMES.index(name) for name in names]] - smpl_rest_m[0]
    turns = Rotation.create_group("O").as_matrix()
    fits = np.einsum("nxy,ix,iy->n", turns, smpl, own / max(np.abs(own).max(), 1e-30))
    upright = turns[fits.argmax()]
    for name, end in [("pelvis", "left_shoulder"), *_bones()]:
        if not joints.keys() >= {name, end}:
            continue
        file_bone = upright @ (bvh.rest[joints[end]] - bvh.rest[joints[name]])
        bone = smpl_rest_m[SMPL_JOINT_NAMES.index(end)] - smpl_rest_m[SMPL_JOINT_NAMES.index(name)]
        farthest_deg = _FARTHEST_ARM_DEG if name in _ARMS else _FARTHEST_FROM_T_DEG
        if (angle := _angle_deg(file_bone, bone)) > farthest_deg:
            raise unusable(
                bvh.path,
                f"at rest with {name} to {end} {angle:.0f} degrees from a T-pose",
                "Export it with a T-pose or an A-pose as rest pose, or with hanging arms.",
            )
    return upright


def _bones() -> list[tuple[str, str]]:
    return [(f"{side}_{one}", f"{side}_{end}") for one, end in _ALIGNED.items() for side in SIDES]


def _angle_deg(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    lengths = np.linalg.norm(one) * np.linalg.norm(other)
    return float(np.degrees(np.arccos(np.clip(one @ other / lengths, -1, 1)))) if lengths else 180.0


def _leg(rest: NDArray[np.float64], joints: Mapping[str, int]) -> float:
    hip, knee, ankle = (rest[joints[f"left_{name}"]] for name in ("hip", "knee", "ankle"))
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def _rest_alignment(
    bvh: BvhFile,
    joints: Mapping[str, int],
    rest: NDArray[np.float64],
    smpl_rest_m: NDArray[np.float64],
) -> dict[str, NDArray[np.float64]]:
    """A_j (3, 3) of the joints that have one."""
    if {plain_name(name) for name in SMPL_JOINT_NAMES[:N_JOINTS]} <= set(
        map(plain_name, bvh.names)
    ):
        return {}
    found = {}
    for name, end in _bones():
        smpl_bone = (
            smpl_rest_m[SMPL_JOINT_NAMES.index(end)] - smpl_rest_m[SMPL_JOINT_NAMES.index(name)]
        )
        found[name] = _shortest_turn(smpl_bone, rest[joints[end]] - rest[joints[name]])
    return found | {f"{side}_wrist": found[f"{side}_elbow"] for side in SIDES}


def _shortest_turn(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation of one direction into another, less than half a turn away."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis, cosine = np.cross(start, end), float(start @ end)
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + cross + cross @ cross / (1 + cosine)


def _local(
    world: NDArray[np.float64],
    joints: Mapping[str, int],
    aligned: Mapping[str, NDArray[np.float64]],
) -> NDArray[np.float64]:
    """(B, 22, 3) axis-angle of each of SMPL's joints to its parent."""
    turns: list[NDArray[np.float64]] = []
    pose = np.zeros((len(world), N_JOINTS, 3))
    for number, name in enumerate(SMPL_JOINT_NAMES[:N_JOINTS]):
        parent = turns[SMPL_PARENTS[number]] if number else np.eye(3)
        if name in joints:
            turn = world[:, joints[name]] @ aligned.get(name, np.eye(3))
        else:
            turn = np.broadcast_to(parent, world[:, 0].shape)
        pose[:, number] = Rotation.from_matrix(np.swapaxes(parent, -1, -2) @ turn).as_rotvec()
        turns.append(turn)
    return pose
