"""From the skeleton of a file to SMPL's 22 joints.

A joint of SMPL turns in the world as the joint of the file does that has its place:

    G_j(t) = U B_j(t) R_j,    local rotation = G_parent(t)^T G_j(t)

B_j is the world rotation of the file's joint from its frame, and R_j turns SMPL's rest pose (a T)
into that frame (`bridge.motion.rest_poses`): by where the joints lie, so the file may rest in any
pose. U brings the file's vertical upright: the axis along which its bodies stand. Joints that the
file lacks do not turn.

At last the limbs of the moved body are compared with the file's joints. Differences are notes of
the motion, or refused where they are no matter of build.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.motion.cuts import frames_of_rest_pose
from bridge.motion.directions import angle_deg, middle, turn_deg, unit
from bridge.motion.motion import AS_IT_SAYS, FARTHEST_M, HowRead, Motion
from bridge.motion.rest_poses import Rest, RestTurns, leg_length, standing_up
from bridge.motion.skeletons import (
    OWN_NAMES,
    SIDES,
    SkeletonMotion,
    joints_by_name,
    unusable,
)
from bridge.motion.theta import pack_theta
from bridge.paper import N_BETAS, N_JOINTS

Places = Mapping[str, NDArray[np.float64]]
"""(S, 3) places of joints in some frames, by SMPL's names."""

_SAMPLED = 240
"""Frames by which a whole motion is judged."""
_STANDING = 0.5
"""Least mean share of the vertical in the directions of trunk and legs."""
_SURELY_STANDING, _SURELY_LYING = 0.8, 0.3
"""The same of what is believed against a rest pose that stands."""
_SAME_FRAME_DEG = 5.0
_STRAIGHT = 0.05
"""Of knees, the mean sine of the bend times how much forwards they point."""
_UPRIGHT = {
    "x": ("z", 90), "-x": ("z", -90), "y": ("x", 0), "-y": ("z", 180), "z": ("x", -90),
    "-z": ("x", 90),
}  # fmt: skip
"""Axis and degrees that bring a vertical to y and leave the heading as it is."""
_LINES = {
    "hips": ("right_hip", "left_hip"),
    "shoulders": ("right_shoulder", "left_shoulder"),
    "trunk": ("pelvis", "neck"),
}
_LIMBS = {
    f"{side}_{one}": (f"{side}_{one}", f"{side}_{end}")
    for one, end in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"),
                     ("ankle", "foot"))
    for side in SIDES
}  # fmt: skip
_WARN_DEG = {"hips": 20.0, "shoulders": 25.0, "trunk": 25.0, "ankle": 40.0}
_LIMB_WARN_DEG, _REFUSED_DEG = 10.0, 60.0
"""Median angles between a body's limb and the file's; people differ in trunk and feet."""


def retargeted(skeleton: SkeletonMotion, how: HowRead = AS_IT_SAYS) -> Motion:
    """The motion as SMPL's joints do it, for a body of the mean shape; y up.

    The hips' path is scaled by the length of the legs, which also brings the file's unit to
    metres. The file has neither shape nor gender. A rest pose before the motion, in which a program
    finds the skeleton, is left out (`bridge.motion.cuts`). A skeleton is refused that lacks a joint
    which a body needs, or whose joints the moved body cannot follow.
    """
    joints = joints_by_name(skeleton, how.joint_map)
    smpl_rest_m: Rest = dict(zip(OWN_NAMES, mean_joints(), strict=True))
    sampled, notes = some_frames(len(skeleton.root)), list(skeleton.notes)
    turns, places = skeleton.posed(sampled)
    legs = leg_length({name: skeleton.rest[joint] for name, joint in joints.items()})
    if not np.isfinite(places).all() or not legs > 0:
        raise unusable(skeleton.path, "whose legs have no length")
    if is_mirrored({name: places[:, joint] for name, joint in joints.items()}):
        axis = int(
            np.abs(skeleton.rest[joints["left_hip"]] - skeleton.rest[joints["right_hip"]]).argmax()
        )
        notes.append(
            f"{skeleton.path} is left-handed, its feet point backwards: "
            f"its {'xyz'[axis]} axis is taken the other way round"
        )
        skeleton = skeleton.mirrored(axis)
        turns, places = skeleton.posed(sampled)
    carriers = joints | {"pelvis": _pelvis_frame(skeleton, joints, turns)}
    carriers |= _twisted(skeleton, joints)
    upright, upright_notes = _upright(skeleton, joints, places, how)
    vertical = upright.T @ [0.0, 1.0, 0.0]
    carried = turns.copy()
    carried[:, [*joints.values()]] = turns[:, [carriers[name] for name in joints]]
    rested = RestTurns(skeleton, joints, smpl_rest_m, (carried, places), vertical)
    rest, feet = rested.rest_turns, rested.feet
    notes += upright_notes
    if feet:
        notes.append(
            f"{skeleton.path} rests with feet that point another way than a standing body's: "
            f"{' and '.join(feet)} are taken to stand flat where they are lowest"
        )
    world = _smpl_turns(upright @ turns, carriers, rest)
    _check(skeleton, joints, world, places @ upright.T, notes)
    scale, count = leg_length(smpl_rest_m) / legs, len(skeleton.root)
    below_m = middle(smpl_rest_m, "hip") - smpl_rest_m["pelvis"]
    pose, trans_m = np.zeros((count, N_JOINTS, 3)), np.empty((count, 3))
    for frames, turns, places in skeleton.blocks():
        world = _smpl_turns(upright @ turns, carriers, rest)
        hips = middle({name: places[:, joint] for name, joint in joints.items()}, "hip")
        # Files have their root anywhere between hips and waist.
        trans_m[frames] = scale * hips @ upright.T - world[:, 0] @ below_m
        pose[frames] = local_rotations(world)
    if (far_m := np.abs(trans_m).max()) > FARTHEST_M:
        raise unusable(skeleton.path, f"that goes {far_m:.3g} m off", "Export it near the origin.")
    fps = how.fps or skeleton.fps
    first = frames_of_rest_pose(pose, fps) if fps > 0 else 0
    return Motion(
        pack_theta(pose[first:], trans_m[first:]), np.zeros(N_BETAS), "unknown",
        skeleton.fps, skeleton.fps, skeleton.path, up="y", rest_pose_frames=first,
        trans_of="joint", notes=tuple(notes),
    )  # fmt: skip


def _smpl_turns(
    world: NDArray, joints: Mapping[str, int], rest: Mapping[str, NDArray]
) -> NDArray[np.float64]:
    """(B, 22, 3, 3) world rotations G_j of SMPL's joints."""
    turns = np.empty((len(world), N_JOINTS, 3, 3))
    for number, name in enumerate(OWN_NAMES):
        if name in rest:
            turns[:, number] = world[:, joints[name]] @ rest[name]
        else:
            turns[:, number] = turns[:, SMPL_PARENTS[number]]
    return turns


def _pelvis_frame(skeleton: SkeletonMotion, joints: Mapping[str, int], turns: NDArray) -> int:
    """The joint in whose frame both hips lie still: one of no length may undo the root's turn."""
    pelvis, (left, right) = joints["pelvis"], (
        skeleton.parents[joints[f"{side}_hip"]] for side in SIDES
    )  # fmt: skip
    if left == right or turn_deg(turns[:, left], turns[:, right]) > _SAME_FRAME_DEG:
        return pelvis
    return left if turn_deg(turns[:, pelvis], turns[:, left]) > _SAME_FRAME_DEG else pelvis


def _twisted(skeleton: SkeletonMotion, joints: Mapping[str, int]) -> dict[str, int]:
    """The last joint of each limb that has several, by the limb: its twist is the limb's."""
    limbs = {name: ends for name, ends in _LIMBS.items() if not name.endswith("ankle")}
    return {
        name: skeleton.parents[joints[end]]
        for name, (_, end) in limbs.items()
        if joints[name] in skeleton.above(joints[end])
    }


def is_mirrored(places: Places) -> bool:
    """Whether feet and knees point backwards, seen from where left and right are."""
    across = unit(places["left_hip"] - places["right_hip"]) + unit(
        places["left_shoulder"] - places["right_shoulder"]
    )
    forward = unit(np.cross(across, middle(places, "shoulder") - middle(places, "hip")))
    toes, knees = [], []
    for side in SIDES:
        hip, knee, ankle = (places[f"{side}_{name}"] for name in ("hip", "knee", "ankle"))
        sine = np.linalg.norm(np.cross(unit(knee - hip), unit(ankle - knee)), axis=-1)
        knees.append(_dots(unit(2 * knee - hip - ankle), forward) * sine)
        if f"{side}_foot" in places:
            shin, toe = unit(knee - ankle), places[f"{side}_foot"] - ankle
            toes.append(_dots(unit(toe - _dots(toe, shin)[:, None] * shin), forward))
    bent = float(np.mean(knees))
    if toes:
        return bool(np.median(toes) < -0.5 and bent < _STRAIGHT)
    return bent < -_STRAIGHT


def _dots(one: NDArray, other: NDArray) -> NDArray[np.float64]:
    return (one * other).sum(axis=-1)


def _upright(
    skeleton: SkeletonMotion, joints: Mapping[str, int], places: NDArray, how: HowRead
) -> tuple[NDArray[np.float64], list[str]]:
    """(3, 3) from the file's world to y up, and notes about it."""
    rest_up = standing_up(skeleton, joints)
    mean = standing_direction({name: places[:, joint] for name, joint in joints.items()})
    axis, notes = _axis(mean), []
    share = float(np.abs(mean).max())
    if how.up != "auto":
        axis = (how.up, 1)
    elif share < _STANDING:
        axis = ("y", 1) if rest_up is None else _axis(rest_up)
        notes.append(
            f"{skeleton.path} stands neither along y nor z for most of the motion: "
            f"taken as {_called(axis)} up, --up says otherwise"
        )
    elif rest_up is not None and _axis(rest_up) != axis:
        rest_axis = letter, sign = _axis(rest_up)
        if share < _SURELY_STANDING or sign * mean["xyz".index(letter)] > _SURELY_LYING:
            axis = rest_axis
        else:
            notes.append(
                f"{skeleton.path} rests with {_called(rest_axis)} up and moves with "
                f"{_called(axis)} up, which is believed: --up says otherwise"
            )
    return upright_turn(*axis), notes


def standing_direction(places: Places) -> NDArray[np.float64]:
    """(3,) mean direction of trunk and legs; shorter than 1 where it changes."""
    hips = middle(places, "hip")
    body = unit(middle(places, "shoulder") - hips) + unit(hips - middle(places, "ankle"))
    return 0.5 * body.mean(axis=0)


def upright_turn(axis: str, sign: int) -> NDArray[np.float64]:
    """(3, 3) that brings a vertical to y and leaves the heading as it is."""
    about, degrees = _UPRIGHT[_called((axis, sign))]
    return Rotation.from_euler(about, degrees, degrees=True).as_matrix().round(12)


def _axis(direction: NDArray) -> tuple[str, int]:
    axis = int(np.abs(direction).argmax())
    return "xyz"[axis], int(np.sign(direction[axis])) or 1


def _called(axis: tuple[str, int]) -> str:
    return axis[0] if axis[1] > 0 else f"-{axis[0]}"


@cache
def mean_joints() -> NDArray[np.float64]:
    """(22, 3) SMPL's joints at rest, of the mean shape, metres."""
    return shaped_joints(load_body_model("embedded:female"), np.zeros((1, N_BETAS)))[0, :N_JOINTS]


def some_frames(count: int) -> NDArray[np.intp]:
    """Numbers of those by which a whole motion is judged."""
    return np.linspace(0, count - 1, min(_SAMPLED, count)).astype(np.intp)


def smpl_places(world: NDArray) -> NDArray[np.float64]:
    """(T, 22, 3) of the mean shape's joints, turned by (T, 22, 3, 3), the root's at the origin."""
    places, rest_m = np.zeros((len(world), N_JOINTS, 3)), mean_joints()
    for joint, parent in enumerate(SMPL_PARENTS[1:N_JOINTS], 1):
        places[:, joint] = places[:, parent] + world[:, parent] @ (rest_m[joint] - rest_m[parent])
    return places


def world_rotations(pose: NDArray) -> NDArray[np.float64]:
    """(T, 22, 3, 3) of joint rotations (T, 22, 3), axis-angle."""
    world = Rotation.from_rotvec(pose.reshape(-1, 3)).as_matrix().reshape(*pose.shape, 3)
    for joint, parent in enumerate(SMPL_PARENTS[1:N_JOINTS], 1):
        world[:, joint] = world[:, parent] @ world[:, joint]
    return world


def local_rotations(world: NDArray) -> NDArray[np.float64]:
    """(T, 22, 3) axis-angle of each joint in its parent's frame, of rotations (T, 22, 3, 3)."""
    local = world.copy()
    for joint, parent in enumerate(SMPL_PARENTS[1:N_JOINTS], 1):
        local[:, joint] = np.swapaxes(world[:, parent], -1, -2) @ world[:, joint]
    return Rotation.from_matrix(local.reshape(-1, 3, 3)).as_rotvec().reshape(len(world), -1, 3)


def _check(
    skeleton: SkeletonMotion,
    joints: Mapping[str, int],
    world: NDArray,
    places: NDArray,
    notes: list[str],
) -> None:
    """Compare limbs and lines of the moved body (S, 22, 3, 3) with the file's (S, J, 3)."""
    moved = smpl_places(world)
    apart_deg: dict[str, float] = {}
    for name, (one, end) in (_LINES | _LIMBS).items():
        if one in joints and end in joints:
            theirs = places[:, joints[end]] - places[:, joints[one]]
            ours = moved[:, OWN_NAMES.index(end)] - moved[:, OWN_NAMES.index(one)]
            apart_deg[name] = float(np.median(angle_deg(theirs, ours)))
    most = {name: _WARN_DEG.get(name.rpartition("_")[2], _LIMB_WARN_DEG) for name in apart_deg}
    far = [name for name, angle in apart_deg.items() if angle > most[name]]
    limbs = ", ".join(f"{name} by {apart_deg[name]:.0f} degrees" for name in far)
    if any(apart_deg[name] > _REFUSED_DEG for name in far):
        remedy = "Export it with a T-pose as rest pose, or say by --joint-map which joint is which."
        raise unusable(skeleton.path, f"whose joints a body cannot follow: off are {limbs}", remedy)
    if far:
        notes.append(f"{skeleton.path} is followed with limbs that differ from the file's: {limbs}")
