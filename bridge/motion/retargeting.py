"""From the skeleton of a file to SMPL's 22 joints.

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

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError
from bridge.motion.motion import FARTHEST_M, Motion, pack_theta
from bridge.paper import N_BETAS, N_JOINTS

_SIDES = ("left", "right")
_OF_A_SIDE = {
    "hip": ("hip", "upleg", "thigh", "upperleg"),
    "knee": ("knee", "leg", "shin", "lowleg", "lowerleg", "calf"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "ball", "foot"),
    "shoulder": ("arm", "upperarm", "uparm", "shoulder", "shldr"),
    "elbow": ("elbow", "forearm", "lowarm", "lowerarm"),
    "wrist": ("wrist", "hand"),
    "collar": ("collar", "clavicle", "shoulder"),
}
"""How files call a joint, best first; each of theirs is taken once, in this order. What is a foot
or a shoulder depends on whether there is an ankle or an arm beside it."""
_OF_THE_MIDDLE = {"pelvis": ("pelvis", "hips", "hip"), "neck": ("neck", "neck1"), "head": ("head",)}
_SPINE = ("spine1", "spine2", "spine3")
_MAY_LACK = {"collar", "foot", "head", "neck", *_SPINE}
_ALIGNED = {"hip": "knee", "knee": "ankle", "shoulder": "elbow", "elbow": "wrist"}
"""Joints whose bone, to the second one, is brought from one rest pose to the other."""
_BONES = [(f"{side}_{one}", f"{side}_{end}") for one, end in _ALIGNED.items() for side in _SIDES]
_ARMS = {f"{side}_{name}" for name in ("shoulder", "elbow") for side in _SIDES}
_FARTHEST_FROM_T_DEG = 75.0
_FARTHEST_ARM_DEG = 110.0
"""Of arms and forearms, which may hang at the sides; the shortest turn then has the palms there."""
_FRAMES_AT_ONCE = 2048

Rest: TypeAlias = Mapping[str, NDArray[np.float64]]
"""(3,) places of joints at rest, by SMPL's names."""


@dataclass(frozen=True, eq=False)
class SkeletonMotion:
    """A skeleton of J joints and its motion of T frames, in a file's own unit and axes."""

    path: Path
    names: tuple[str, ...]
    """Of the joints, parents first."""
    parents: tuple[int, ...]
    """Of each joint; -1 of the root."""
    rest: NDArray[np.float64]
    """(J, 3) places where every rotation is none; the root's is its offset."""
    axes: tuple[str, ...]
    """Of each joint the order of its turns, such as `ZXY`: each about the axes that it then has."""
    angles_rad: NDArray[np.float64]
    """(T, J, 3) in that order."""
    root: NDArray[np.float64]
    """(T, 3) place of the root."""
    places: Mapping[int, NDArray[np.float64]]
    """(T, 3) by joint below the root that has them: its place in its parent's frame."""
    fps: float

    def blocks(self) -> Iterator[tuple[slice, NDArray[np.float64], NDArray[np.float64]]]:
        """Frames, rotations (B, J, 3, 3) and places (B, J, 3) of the joints in the file's world."""
        for start in range(0, len(self.root), _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, len(self.root)))
            angles = self.angles_rad[frames]
            turns, places = np.empty((*angles.shape[:2], 3, 3)), np.empty(angles.shape)
            for joint, (parent, axes) in enumerate(zip(self.parents, self.axes, strict=True)):
                own = Rotation.from_euler(axes, angles[:, joint]).as_matrix()
                if parent < 0:
                    turns[:, joint], places[:, joint] = own, self.root[frames]
                    continue
                turns[:, joint] = turns[:, parent] @ own
                bone = np.broadcast_to(self.rest[joint] - self.rest[parent], (len(angles), 3))
                bone = self.places[joint][frames] if joint in self.places else bone
                moved = np.einsum("txy,ty->tx", turns[:, parent], bone)
                places[:, joint] = places[:, parent] + moved
            yield frames, turns, places


def unusable(path: Path, flaw: str, remedy: str = "") -> DsnetError:
    """The line that says why a file is refused."""
    usual = "Export it with three rotations on every joint, and three positions on the root."
    return DsnetError(f"{path}, {flaw}", "a BVH motion of a person", remedy or usual)


def retargeted(skeleton: SkeletonMotion) -> Motion:
    """The motion as SMPL's joints do it, for a body of the mean shape; z up, as AMASS has it.

    The root's path is scaled by the length of the legs, which also brings the file's unit to
    metres. The file tells neither shape nor gender. A skeleton is refused that lacks a joint which
    a body needs, or that rests neither in a T or an A nor with hanging arms.
    """
    joints = _joints_by_name(skeleton)
    model_rest_m = shaped_joints(load_body_model("embedded:female"), np.zeros((1, N_BETAS)))[0]
    smpl_rest_m: Rest = dict(zip(SMPL_JOINT_NAMES, model_rest_m, strict=True))
    file_rest: Rest = {name: skeleton.rest[joint] for name, joint in joints.items()}
    upright = _axes(skeleton.path, file_rest, smpl_rest_m)
    upright_rest = skeleton.rest @ upright.T
    file_rest = {name: upright_rest[joint] for name, joint in joints.items()}
    scale = _leg(smpl_rest_m) / _leg(file_rest)
    aligned: dict[str, NDArray[np.float64]] = {}
    own = {plain_name(name) for name in SMPL_JOINT_NAMES[:N_JOINTS]}
    if not own <= set(map(plain_name, skeleton.names)):
        for name, end in _BONES:
            smpl_bone, file_bone = (rest[end] - rest[name] for rest in (smpl_rest_m, file_rest))
            aligned[name] = _shortest_turn(smpl_bone, file_bone)
        aligned |= {f"{side}_wrist": aligned[f"{side}_elbow"] for side in _SIDES}
    count = len(skeleton.root)
    pose, trans_m = np.zeros((count, N_JOINTS, 3)), np.empty((count, 3))
    for frames, turns, places in skeleton.blocks():
        world = upright @ turns @ upright.T
        trans_m[frames] = scale * places[:, joints["pelvis"]] @ upright.T
        found: list[NDArray[np.float64]] = []  # G_j
        for number, name in enumerate(SMPL_JOINT_NAMES[:N_JOINTS]):
            parent = found[SMPL_PARENTS[number]] if number else np.eye(3)
            turn = np.broadcast_to(parent, world[:, 0].shape)
            if name in joints:
                turn = world[:, joints[name]] @ aligned.get(name, np.eye(3))
            local = Rotation.from_matrix(np.swapaxes(parent, -1, -2) @ turn)
            pose[frames, number] = local.as_rotvec()
            found.append(turn)
    if (far_m := np.abs(trans_m).max()) > FARTHEST_M:
        raise unusable(skeleton.path, f"that goes {far_m:.3g} m off", "Export it near the origin.")
    z_up = Rotation.from_euler("x", 90, degrees=True)
    pose[:, 0] = (z_up * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    theta, fps = pack_theta(pose, z_up.apply(trans_m)), skeleton.fps
    return Motion(theta, np.zeros(N_BETAS), "unknown", fps, fps, skeleton.path, up="z")


def _joints_by_name(skeleton: SkeletonMotion) -> dict[str, int]:
    """Number of the file's joint for each of SMPL's 22 that it has."""
    names = reversed([*enumerate(skeleton.names)])
    free = {plain_name(name): number for number, name in names}
    calls_of = dict(_OF_THE_MIDDLE)
    for name, calls in _OF_A_SIDE.items():
        for side in _SIDES:
            calls_of[f"{side}_{name}"] = tuple(side[0] + call for call in calls)
    found: dict[str, int] = {}
    for name, calls in calls_of.items():
        if call := next((call for call in calls if call in free), None):
            found[name] = free.pop(call)
    needed = [
        name
        for name in SMPL_JOINT_NAMES[:N_JOINTS]
        if name.removeprefix("left_").removeprefix("right_") not in _MAY_LACK
    ]
    if missing := [name for name in needed if name not in found]:
        has = ", ".join(skeleton.names)[:200]
        raise unusable(
            skeleton.path,
            f"whose skeleton has no {', '.join(missing)} (it has {has})",
            "Rename its joints as SMPL or Mixamo do.",
        )
    return found | _spine(skeleton, found)


def plain_name(name: str) -> str:
    """`mixamorig:LeftUpLeg`, `upleg.L` and `L_UpLeg` as `lupleg`."""
    name = name.rpartition(":")[2]
    name = re.sub(r"^([mf]_avg_|mixamorig\d*_?|bip\d*[ _]?)", "", name, flags=re.IGNORECASE)
    if of_side := re.fullmatch(r"(.+)[._ ](l|r|left|right)", name, flags=re.IGNORECASE):
        name = of_side[2] + of_side[1]
    return re.sub(r"^(l|r)(eft|ight)", r"\1", re.sub(r"[^a-z0-9]", "", name.lower()))


def _spine(skeleton: SkeletonMotion, found: Mapping[str, int]) -> dict[str, int]:
    """Of the joints between pelvis and neck the lowest, the middle and the highest."""
    joint = skeleton.parents[found.get("neck", found.get("head", found["left_shoulder"]))]
    between: list[int] = []
    while joint >= 0 and joint != found["pelvis"]:
        between.insert(0, joint)
        joint = skeleton.parents[joint]
    between = [joint for joint in between if joint not in found.values()]
    if not between:
        return {}
    if len(between) == 1:
        return {_SPINE[1]: between[0]}
    if len(between) == 2:
        return {_SPINE[0]: between[0], _SPINE[2]: between[1]}
    return dict(zip(_SPINE, (between[0], between[len(between) // 2], between[-1]), strict=True))


def _axes(path: Path, file_rest: Rest, smpl_rest_m: Rest) -> NDArray[np.float64]:
    """(3, 3) from the file's axes to SMPL's: of the 24 turns of a cube the one that fits best."""
    own = np.array([place - file_rest["pelvis"] for place in file_rest.values()])
    smpl = np.array([smpl_rest_m[name] - smpl_rest_m["pelvis"] for name in file_rest])
    turns = Rotation.create_group("O").as_matrix()
    fits = np.einsum("nxy,ix,iy->n", turns, smpl, own / max(np.abs(own).max(), 1e-30))
    upright = turns[fits.argmax()]
    for name, end in [("pelvis", "left_shoulder"), *_BONES]:
        file_bone = upright @ (file_rest[end] - file_rest[name])
        bone = smpl_rest_m[end] - smpl_rest_m[name]
        lengths = np.linalg.norm(file_bone) * np.linalg.norm(bone)
        cosine = np.clip(file_bone @ bone / lengths, -1, 1) if lengths else -1.0
        farthest_deg = _FARTHEST_ARM_DEG if name in _ARMS else _FARTHEST_FROM_T_DEG
        if (angle := np.degrees(np.arccos(cosine))) > farthest_deg:
            raise unusable(
                path,
                f"at rest with {name} to {end} {angle:.0f} degrees from a T-pose",
                "Export it with a T-pose or an A-pose as rest pose, or with hanging arms.",
            )
    return upright


def _leg(rest: Rest) -> float:
    hip, knee, ankle = (rest[f"left_{name}"] for name in ("hip", "knee", "ankle"))
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def _shortest_turn(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation of one direction into another, less than half a turn away."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis, cosine = np.cross(start, end), float(start @ end)
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + cross + cross @ cross / (1 + cosine)
