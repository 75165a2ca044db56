"""One walk on one skeleton, as a BVH and as SMPL's arrays of many layouts."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.motion import load_motion, unpack_theta
from tests.forged.bvh import Skeleton, text, world_of

FRAMES, FPS = 90, 60.0
MIXAMO = (
    "Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot",
    "RightFoot", "Spine2", "LeftToeBase", "RightToeBase", "Neck", "LeftShoulder", "RightShoulder",
    "Head", "LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand",
    "LeftHandEnd", "RightHandEnd",
)  # fmt: skip
_HALF = {
    0: (0, 0, 0), 1: (9.5, -5, 0), 3: (0, 11, -0.5), 4: (9.5, -46, 0), 6: (0, 23, -0.5),
    7: (9.5, -86, 0), 9: (0, 35, -0.5), 10: (9.5, -93, 13), 12: (0, 51, -0.5),
    13: (5.5, 47.5, -0.5), 15: (0, 60, 1), 16: (17, 47.5, -0.5), 18: (44, 47.5, -0.5),
    20: (68.5, 47.5, -0.5), 22: (78.5, 47.5, -0.5),
}  # fmt: skip
REST_CM = np.array(
    [_HALF[n] if n in _HALF else np.multiply(_HALF[n - 1], (-1, 1, 1)) for n in range(24)], float
)
Turns = Mapping[int, np.ndarray]


def about(axis: str, degrees: float) -> np.ndarray:
    """(3, 3) rotation."""
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


@cache
def walk() -> tuple[np.ndarray, np.ndarray]:
    """Pose (T, 22, 3) and places of the pelvis (T, 3), metres, y up."""
    pose, places_m = unpack_theta(load_motion("sample:walking").theta[:FRAMES])
    return pose, np.asarray(places_m, np.float64)


def bvh(
    names: Sequence[str] = MIXAMO,
    frames: Turns | None = None,
    world: np.ndarray | None = None,
    mirror: bool = False,
    rest_cm: np.ndarray = REST_CM,
) -> str:
    """The walk as a BVH.

    Parameters
    ----------
    frames : what turns a T's joints into the file's, by joint, others not at all.
    world : (3, 3) what turns y up into the file's world.
    mirror : whether x goes the other way round.
    rest_cm : (24, 3) places of joints in a T.
    """
    pose, places_m = walk()
    own = {joint: (frames or {}).get(joint, np.eye(3)) for joint in range(24)}
    outer = np.eye(3) if world is None else world
    turns = np.stack([outer @ world_of(pose)[:, n] @ own[n].T for n in range(24)], axis=1)
    rest = rest_cm.copy()
    for joint, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            rest[joint] = rest[parent] + own[parent] @ (rest_cm[joint] - rest_cm[parent])
    root = 100 * places_m @ outer.T
    if mirror:
        sign = np.diag([-1.0, 1.0, 1.0])
        turns, rest, root = sign @ turns @ sign, rest @ sign, root @ sign
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")  # where a world lies on its side
        return text(Skeleton(names, SMPL_PARENTS, rest), turns, root)


def undone_hips() -> str:
    """Joints of no length undo the root's turn."""
    pose, places_m = walk()
    world = world_of(pose)
    extra = ["LHipJoint", "RHipJoint", "LowerBack"]
    parents, rest = [*SMPL_PARENTS, 0, 0, 0], np.concatenate([REST_CM, np.zeros((3, 3))])
    parents[1], parents[2], parents[3] = 24, 25, 26
    turns = np.concatenate([world, np.repeat(world[:, :1], 3, axis=1)], axis=1)
    turns[:, 0] = world[:, 0] @ about("y", 80)
    order = [0, 24, 25, 26, *range(1, 24)]
    names = [[*MIXAMO, *extra][n] for n in order]
    moved = [-1 if parents[n] < 0 else order.index(parents[n]) for n in order]
    return text(Skeleton(names, moved, rest[order]), turns[:, order], 100 * places_m)


def twisted() -> str:
    """Limbs of two bones, of which the second twists, as Daz's Genesis 3 and 8 have them."""
    pose, places_m = walk()
    world = world_of(pose)
    names = named(
        "hip,abdomenUpper,chestLower,chestUpper,neckLower,head",
        "ThighBend,Shin,Foot,Toe,Collar,ShldrBend,ForearmBend,Hand", "{s}{name}",
    )  # fmt: skip
    parents, rest, turns = [*SMPL_PARENTS], [*REST_CM], [*np.moveaxis(world, 1, 0)]
    limbs = ((1, 4, "ThighTwist"), (16, 18, "ShldrTwist"), (18, 20, "ForearmTwist"))
    extra = [(one + n, end + n, f"{'lr'[n]}{name}") for one, end, name in limbs for n in (0, 1)]
    for above, below, name in [(0, 3, "abdomenLower"), (0, 1, "pelvis"), *extra]:
        parents[below], bone = len(names), REST_CM[below] - REST_CM[above]
        names.append(name)
        parents.append(above)
        rest.append(REST_CM[above] + 0.5 * bone)
        turns.append(world[:, above])
        if "Twist" in name:
            angle_rad = 0.5 * np.sin(np.arange(FRAMES) / 9)[:, None]
            back = Rotation.from_rotvec(angle_rad * bone / np.linalg.norm(bone)).as_matrix()
            turns[above] = world[:, above] @ back
    parents[2] = names.index("pelvis")
    return text(Skeleton(names, parents, np.array(rest)), np.stack(turns, 1), 100 * places_m)


def named(middle: str, limbs: str, style: str) -> list[str]:
    """Names of hips, three of a spine, neck and head, then of a side's limbs in a style.

    Limbs are thigh, shin, foot, toe, collar, upper arm, forearm and hand; the style has `{side}`,
    `{s}`, `{S}` and `{name}`.
    """
    found: list[str] = [*MIXAMO]
    for number, name in zip((0, 3, 6, 9, 12, 15), middle.split(","), strict=True):
        found[number] = name
    for number, name in zip((1, 4, 7, 10, 13, 16, 18, 20), limbs.split(","), strict=True):
        for joint, side in ((number, "Left"), (number + 1, "Right")):
            found[joint] = style.format(side=side, s=side[0].lower(), S=side[0], name=name)
    return found


_X = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_ALONG_X: Turns = dict.fromkeys((0, 3, 6, 9, 12, 15), _X) | {
    **dict.fromkeys((1, 2, 4, 5), about("z", 90)),
    **dict.fromkeys((7, 8, 10, 11), about("y", 90)),
    **dict.fromkeys((14, 17, 19, 21), about("z", 180)),
}


def along_x(*, legs: float = 0, arms: float = 0, forearms: float = 0) -> Turns:
    """All bones along x, as LAFAN1's, and frames of limbs turned about them by so many degrees."""
    parts = {(1, 2, 4, 5): legs, (16, 17): arms, (18, 19, 20, 21): forearms}
    by = {joint: degrees for joints, degrees in parts.items() for joint in joints}
    return {n: about("x", by.get(n, 0)) @ _ALONG_X.get(n, np.eye(3)) for n in range(24)}


HANGING: Turns = {
    **dict.fromkeys((16, 18, 20, 22), about("z", -75)),
    **dict.fromkeys((17, 19, 21, 23), about("z", 75)),
}
RAISED: Turns = {
    **dict.fromkeys((13, 16, 18, 20, 22), about("z", 90)),
    **dict.fromkeys((14, 17, 19, 21, 23), about("z", -90)),
}
TOES_DOWN: Turns = dict.fromkeys((7, 8, 10, 11), about("x", 62))


def turned(degrees: float) -> Turns:
    return dict.fromkeys(range(24), about("y", degrees))


def edited(*changes: tuple[str, str]) -> str:
    whole = bvh()
    for pattern, put in changes:
        whole, count = re.subn(pattern, put, whole, flags=re.MULTILINE)
        assert count, pattern
    return whole


def root_reordered() -> str:
    head, _, rows = bvh().partition("Frame Time: 0.016666667\n")
    head = head.replace("Xposition Yposition Zposition", "Zposition Yposition Xposition")
    lines = [row.split(" ", 3) for row in rows.splitlines()]
    body = "\n".join(" ".join((z, y, x, *rest)) for x, y, z, *rest in lines)
    return f"{head}Frame Time: 0.016666667\n{body}\n"


def two_people() -> str:
    head, _, rows = bvh().partition("MOTION\n")
    second = head.removeprefix("HIERARCHY\n")
    for name in MIXAMO:
        second = re.sub(rf"(ROOT|JOINT) {name}$", rf"\1 B_{name}", second, flags=re.MULTILINE)
    declared, time, *lines = rows.splitlines()
    body = "\n".join(f"{line} {line}" for line in lines)
    return f"{head}{second}MOTION\n{declared}\n{time}\n{body}\n"


def prop_first() -> str:
    """A root that is no person's before the person's."""
    prop = """HIERARCHY\nROOT Prop\n{\nOFFSET 0 0 0
CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
End Site\n{\nOFFSET 0 9 0\n}\n}\n"""
    head, time, rows = bvh().partition("Frame Time: 0.016666667\n")
    body = "".join(f"12 80 3 0 0 0 {row}\n" for row in rows.splitlines())
    return f"{head.replace('HIERARCHY' + chr(10), prop)}{time}{body}"


def wrapped() -> str:
    """Twelve numbers a line."""
    head, time, rows = bvh().partition("Frame Time: 0.016666667\n")
    return head + time + re.sub(r"((?:\S+ ){12})", r"\1\n", rows)


def trunk_cm(degrees: float) -> np.ndarray:
    """(24, 3) rest in a T whose lowest trunk joint lies so far ahead of the hips' vertical."""
    rest, hips = REST_CM.copy(), REST_CM[[1, 2]].mean(axis=0)
    rest[3] = hips + np.array([0.0, 8.0, 8.0 * np.tan(np.radians(degrees))])
    return rest


def flipped(name: str) -> str:
    """One leaf turned round in one frame."""
    whole = bvh()
    head, _, rows = whole.partition("Frame Time: 0.016666667\n")
    joints = re.findall(r"(?:ROOT|JOINT) (\w+)", head)
    column = 3 + 3 * joints.index(name)
    lines = [row.split() for row in rows.splitlines()]
    lines[40][column] = str(float(lines[40][column]) + 170)
    return f"{head}Frame Time: 0.016666667\n" + "\n".join(map(" ".join, lines)) + "\n"


def in_radians() -> str:
    head, _, rows = bvh().partition("Frame Time: 0.016666667\n")
    numbers = np.array([row.split() for row in rows.splitlines()], float)
    numbers[:, 3:] = np.radians(numbers[:, 3:])
    body = "\n".join(" ".join(map(str, row)) for row in numbers)
    return f"{head}Frame Time: 0.016666667\n{body}\n"


def smpl(**changes: Any) -> dict[str, Any]:
    """SMPL-H's arrays of the walk, z up, as AMASS has them; a change to None leaves one out."""
    pose, places_m = walk()
    turned = about("x", 90)
    poses = np.zeros((FRAMES, 156))
    poses[:, :66] = pose.reshape(FRAMES, 66)
    poses[:, :3] = Rotation.from_matrix(turned @ matrices(pose[:, 0])).as_rotvec()
    arrays = {"poses": poses, "trans": places_m @ turned.T, "betas": np.zeros(16),
              "gender": "female", "mocap_framerate": FPS} | changes  # fmt: skip
    return {name: value for name, value in arrays.items() if value is not None}


def matrices(rotvecs: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(*rotvecs.shape, 3)


def y_up(width: int = 72) -> np.ndarray:
    """(T, width) poses of a world with y up."""
    pose, _ = walk()
    return np.pad(pose.reshape(FRAMES, 66), ((0, 0), (0, width - 66)))


def joints_m() -> np.ndarray:
    """(T, 22, 3) places of SMPL's joints, y up."""
    rest_m = shaped_joints(load_body_model("embedded:female"), np.zeros((1, 10)))[0]
    pose, places_m = walk()
    world, found = world_of(pose), np.zeros((FRAMES, 22, 3))
    found[:, 0] = places_m
    for joint in range(1, 22):
        parent = SMPL_PARENTS[joint]
        found[:, joint] = found[:, parent] + world[:, parent] @ (rest_m[joint] - rest_m[parent])
    return found


def person(**changes: Any) -> dict[str, Any]:
    """What WHAM says of one."""
    found = {"pose": y_up(), "trans": walk()[1], "betas": np.zeros((FRAMES, 10)),
             "frame_ids": np.arange(FRAMES)}  # fmt: skip
    return found | changes


def of_camera(
    pitch_deg: float, *, floor: bool = True, steps: slice = slice(None)
) -> dict[str, Any]:
    """SLAHMR's arrays of two people, the second a metre beside the first, in the world of a camera
    that looks up by so many degrees: y down."""
    turn = about("x", 180 - pitch_deg)
    root = Rotation.from_matrix(turn @ matrices(walk()[0][:, 0])).as_rotvec()[steps]
    beside = np.array([[[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]])
    found = {
        "root_orient": np.stack([root, root]),
        "pose_body": np.stack([y_up()[steps, 3:66]] * 2),
        "trans": (walk()[1][steps] + beside) @ turn.T,
        "betas": np.zeros((2, 16)),
        "cam_R": np.stack([np.broadcast_to(np.eye(3), (len(root), 3, 3))] * 2),
        "track_mask": np.ones((2, len(root)), bool),
    }
    return found | ({"floor_plane": 0.9 * turn[None, :, 1]} if floor else {})


def by_frames(numbers: np.ndarray) -> dict[Any, Any]:
    """WHAM's of a tracker that saw a person in these frames alone."""
    return {0: {name: value[numbers] for name, value in person().items()}}
