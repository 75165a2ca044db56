"""What turns SMPL's rest pose into the frames of a file's joints, by where its joints lie.

The pelvis has two hips and a spine, which tell its frame; the chest has collars and a neck. From
there each joint's frame is that of the one above it, if its bone then points where SMPL's does. If
not, it is turned by the shortest turn of a cube that brings the bone there. How it is turned about
the bone, no place tells: of four quarters that is taken in which the joint turns least throughout
the motion. Thighs, shins, upper arms and forearms are brought exactly onto the file's bones, hands
go with forearms. Of trunk, head and feet the two builds are taken to be alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_PARENTS
from bridge.motion.skeletons import OWN_NAMES, SIDES, SkeletonMotion, unusable

Rest: TypeAlias = Mapping[str, NDArray[np.float64]]
"""(3,) places of joints at rest, by SMPL's names."""

_X, _Y, _Z = np.eye(3)
_BONES: dict[str, tuple[str | None, NDArray[np.float64], float]] = {
    "spine1": ("spine2", _Y, 50.0),
    "spine2": ("spine3", _Y, 50.0),
    "spine3": ("neck", _Y, 50.0),
    "neck": ("head", _Y, 60.0),
    "head": (None, _Y, 60.0),
}
"""Of a joint: where its bone ends (None: at its tip), along which axis it points in a T, and how
far it may be from there and still be taken for alike."""
for _side, _out in zip(SIDES, (_X, -_X), strict=True):
    _BONES |= {
        f"{_side}_hip": (f"{_side}_knee", -_Y, 75.0),
        f"{_side}_knee": (f"{_side}_ankle", -_Y, 75.0),
        f"{_side}_ankle": (f"{_side}_foot", _Z, 55.0),
        f"{_side}_foot": (None, _Z, 60.0),
        f"{_side}_collar": (f"{_side}_shoulder", _out, 60.0),
        f"{_side}_shoulder": (f"{_side}_elbow", _out, 110.0),
        f"{_side}_elbow": (f"{_side}_wrist", _out, 110.0),
        f"{_side}_wrist": (None, _out, 60.0),
    }
_LIMBS = ("hip", "knee", "shoulder", "elbow")
_SNAPPED_UP_DEG, _SNAPPED_SIDE_DEG = 25.0, 10.0
_OTHER_CHEST_DEG = 30.0
_FOOT_SHAPE_DEG = 12.0, 50.0
"""Between the lines from ankle to toes and along them, in a flat foot."""
_STANCE = 0.25
"""Of a motion's frames, so many in which a foot surely stands."""
_CLEARLY_DEG = 15.0
"""By so much less a joint must turn in another quarter."""


@dataclass
class RestTurns:
    """What `rest_turns` finds."""

    turns: dict[str, NDArray[np.float64]]
    """(3, 3) R_j by SMPL's names."""
    notes: list[str] = field(default_factory=list)


def standing_up(skeleton: SkeletonMotion, joints: Mapping[str, int]) -> NDArray[np.float64] | None:
    """(3,) where the head is in the file's axes if it rests as somebody stands; else None."""
    rest = {name: skeleton.rest[joint] for name, joint in joints.items()}
    up = _pelvis(skeleton.path, rest) @ _Y
    trunk = _mean(rest, "shoulder") - _mean(rest, "hip")
    legs = [rest[f"{side}_ankle"] - rest[f"{side}_hip"] for side in SIDES]
    stands = _angle_deg(trunk, up) < 45 and all(_angle_deg(leg, -up) < 60 for leg in legs)
    return up if stands else None


def rest_turns(
    skeleton: SkeletonMotion,
    joints: Mapping[str, int],
    smpl_rest_m: Rest,
    sample: tuple[NDArray, NDArray],
    up: NDArray,
    *,
    is_smpls: bool,
) -> RestTurns:
    """R_j of every joint of SMPL's that the file has.

    Parameters
    ----------
    joints : numbers of the file's joints by SMPL's names.
    sample : (S, J, 3, 3) rotations and (S, J, 3) places of the file's joints in some frames.
    up : (3,) vertical of the file's world.
    is_smpls : whether the skeleton is SMPL's own, by its names: bones are taken as they are.
    """
    rest = {name: skeleton.rest[joint] for name, joint in joints.items()}
    turns, places = sample
    frames = {"pelvis": _pelvis(skeleton.path, rest)}
    found, odd = dict(frames), []
    chest = _chest_frame(skeleton, joints, rest)
    parents = {
        name: OWN_NAMES[parent] for name, parent in zip(OWN_NAMES, SMPL_PARENTS, strict=False)
    }
    is_stance = standing_up(skeleton, joints) is not None
    for name in OWN_NAMES[1:]:
        if name not in joints:
            continue
        above = parents[name]
        while above not in found:
            above = parents[above]
        end, along, most_deg = _BONES[name]
        frame, bone = (
            frames[above],
            _bone(skeleton, joints, name, end, tips=not is_stance or above in odd),
        )
        if name == "spine3" and chest is not None and _turn_deg(frame, chest) > _OTHER_CHEST_DEG:
            frame = chest
        smpl_bone = along
        if name.endswith((*_LIMBS, "ankle")) and end is not None:
            smpl_bone = smpl_rest_m[end] - smpl_rest_m[name]
        if bone is not None and not is_stance and name.endswith(("shoulder", "elbow")):
            most_deg = 50.0
        if bone is not None and not is_smpls and _angle_deg(frame @ smpl_bone, bone) > most_deg:
            if (from_tip := _foot_frame(skeleton, joints, name, frame, bone)) is not None:
                frame = from_tip
            elif name.endswith("ankle"):
                frame = _on_the_floor(
                    turns[:, joints[name]],
                    places[:, joints.get(end or name, joints[name])] @ up,
                    up,
                    bone,
                )
                odd.append(name)
            else:
                choose = (turns[:, joints[above]] @ found[above], turns[:, joints[name]])
                frame = _swung(frame, along, bone, choose)
                odd.append(name)
        frames[name] = found[name] = frame
        if name.endswith("wrist") and name not in odd:
            found[name] = found[above]
        elif bone is not None and name.endswith(_LIMBS) and not is_smpls:
            found[name] = shortest_turn(frame @ smpl_bone, bone) @ frame
        elif bone is not None and above in odd and name.endswith("foot"):
            toes = joints[name]
            found[name] = _on_the_floor(turns[:, toes], places[:, toes] @ up, up, bone)
    notes = []
    if feet := [name for name in odd if name.endswith("ankle")]:
        notes.append(
            f"{skeleton.path} rests with feet that point elsewhere than a standing body's: "
            f"{' and '.join(feet)} are taken to stand flat where they are lowest"
        )
    return RestTurns(found, notes)


def leg_length(rest: NDArray, joints: Mapping[str, int]) -> float:
    """Of the left thigh and shin, of places (J, 3)."""
    hip, knee, ankle = (rest[joints[f"left_{name}"]] for name in ("hip", "knee", "ankle"))
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def shortest_turn(start: NDArray, end: NDArray) -> NDArray[np.float64]:
    """(3, 3) rotation of one direction into another, less than half a turn away."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis, cosine = np.cross(start, end), float(start @ end)
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + cross + cross @ cross / (1 + cosine)


def _mean(rest: Rest, name: str) -> NDArray[np.float64]:
    return 0.5 * (rest[f"left_{name}"] + rest[f"right_{name}"])


def _pelvis(path: Path, rest: Rest) -> NDArray[np.float64]:
    found = _frame(rest, "hip", _mean(rest, "hip"), _above(rest))
    if found is None:
        raise unusable(path, "whose hips and trunk lie in one line at rest")
    return found


def _above(rest: Rest) -> NDArray[np.float64]:
    """The lowest joint of the trunk that is not in the pelvis itself."""
    shoulders, hips = _mean(rest, "shoulder"), _mean(rest, "hip")
    for name in ("spine1", "spine2", "spine3", "neck"):
        if name in rest and np.linalg.norm(
            rest[name] - rest["pelvis"]
        ) > 1e-6 + 0.02 * np.linalg.norm(shoulders - hips):
            return rest[name]
    return shoulders


def _frame(rest: Rest, pair: str, low: NDArray, high: NDArray) -> NDArray[np.float64] | None:
    """(3, 3) left, up and forward as columns: the file's own axes where they are near.

    None where left is up.
    """
    up = _snapped(_unit(high - low), _SNAPPED_UP_DEG)
    left = rest[f"left_{pair}"] - rest[f"right_{pair}"]
    left = left - (left @ up) * up
    if not np.linalg.norm(left) > 1e-6 * np.linalg.norm(high - low):
        return None
    left = _snapped(_unit(left), _SNAPPED_SIDE_DEG)
    left = _unit(left - (left @ up) * up)
    return np.stack([left, up, np.cross(left, up)], axis=1).astype(np.float64)


def _snapped(direction: NDArray, most_deg: float) -> NDArray[np.float64]:
    axis = np.zeros(3)
    number = int(np.abs(direction).argmax())
    axis[number] = np.sign(direction[number])
    return axis if _angle_deg(direction, axis) < most_deg else direction


def _unit(direction: NDArray) -> NDArray[np.float64]:
    return direction.astype(np.float64) / max(float(np.linalg.norm(direction)), 1e-30)


def _angle_deg(one: NDArray, other: NDArray) -> float:
    return float(np.degrees(np.arccos(np.clip(_unit(one) @ _unit(other), -1, 1))))


def _turn_deg(one: NDArray, other: NDArray) -> float:
    return float(np.degrees(Rotation.from_matrix(one.T @ other).magnitude()))


def _chest_frame(
    skeleton: SkeletonMotion, joints: Mapping[str, int], rest: Rest
) -> NDArray[np.float64] | None:
    """Of the joint from which both collars and the neck go out."""
    pair = "collar" if {"left_collar", "right_collar"} <= rest.keys() else "shoulder"
    ends = [joints.get(name, -1) for name in (f"left_{pair}", f"right_{pair}", "neck")]
    if "spine3" not in joints or any(
        end < 0 or skeleton.parents[end] != joints["spine3"] for end in ends
    ):
        return None
    if np.linalg.norm(rest["neck"] - rest["spine3"]) < 1e-9:
        return None
    return _frame(rest, pair, rest["spine3"], rest["neck"])


def _bone(
    skeleton: SkeletonMotion, joints: Mapping[str, int], name: str, end: str | None, *, tips: bool
) -> NDArray[np.float64] | None:
    """(3,) from a joint to where its bone ends; None where that is not known.

    What writes a T or an A writes tips that mean nothing.
    """
    place = skeleton.rest[joints[name]]
    if end is not None and end in joints:
        bone = skeleton.rest[joints[end]] - place
    elif tips and joints[name] in skeleton.tips:
        bone = skeleton.tips[joints[name]] - place
    else:
        return None
    return bone if np.linalg.norm(bone) > 1e-9 else None


def _swung(
    frame: NDArray, along: NDArray, bone: NDArray, choose: tuple[NDArray, NDArray]
) -> NDArray[np.float64]:
    """The frame turned so that its axis `along` points as the bone, in the quietest quarter."""
    start, end = frame @ along, _snapped(_unit(bone), 40.0)
    if _angle_deg(start, end) > 179.0:
        swing = Rotation.from_rotvec(
            np.pi * _unit(frame @ (_Z if abs(along @ _Z) < 0.5 else _X))
        ).as_matrix()
    else:
        swing = shortest_turn(start, end)
    quarters = [
        Rotation.from_rotvec(n * np.pi / 2 * _unit(end)).as_matrix() @ swing @ frame
        for n in range(4)
    ]
    above, own = choose
    turned_deg = []
    for quarter in quarters:
        local = np.swapaxes(above, -1, -2) @ own @ quarter
        turned_deg.append(np.degrees(np.median(Rotation.from_matrix(local).magnitude())))
    best = int(np.argmin(turned_deg))
    return quarters[best if turned_deg[best] < turned_deg[0] - _CLEARLY_DEG else 0]


def _foot_frame(
    skeleton: SkeletonMotion, joints: Mapping[str, int], name: str, frame: NDArray, bone: NDArray
) -> NDArray[np.float64] | None:
    """Of an ankle whose toes rest bent down or up, as one piece: by the line along the toes."""
    toes = joints.get(f"{name.partition('_')[0]}_foot", -1)
    if not name.endswith("ankle") or toes not in skeleton.tips:
        return None
    flat = skeleton.tips[toes] - skeleton.rest[toes]
    least_deg, most_deg = _FOOT_SHAPE_DEG
    if np.linalg.norm(flat) < 1e-9 or not least_deg < _angle_deg(flat, bone) < most_deg:
        return None
    return shortest_turn(frame @ _Z, flat) @ frame


def _on_the_floor(
    turns: NDArray, heights: NDArray, up: NDArray, bone: NDArray
) -> NDArray[np.float64]:
    """Of an ankle or toes (S, 3, 3) that stand flat where toes are lowest, at heights (S,)."""
    lowest = turns[heights <= np.quantile(heights, _STANCE)]
    sole = _unit(np.median(np.swapaxes(lowest, -1, -2) @ up, axis=0))
    forward = bone - (bone @ sole) * sole
    forward = _unit(forward if np.linalg.norm(forward) > 1e-9 else np.cross(sole, _X))
    return np.stack([np.cross(sole, forward), sole, forward], axis=1).astype(np.float64)
