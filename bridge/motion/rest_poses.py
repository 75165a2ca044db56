"""What turns SMPL's rest pose into the frames of a file's joints, by where its joints lie.

The pelvis is upright where trunk and legs are in the mean, between two hips; the chest has collars
and a neck. From there each joint's frame is that of the one above it, if its bone then points where
SMPL's does. If not, it is turned by the shortest turn of a cube that brings the bone there; in the
trunk only if it turns less then throughout the motion. How it is turned about
the bone, no place says: of four quarters that is taken in which the joint turns least throughout
the motion; so it is with leaves where nobody stands as the file rests. Feet that rest elsewhere
than a standing body's are taken to stand flat where their toes are lowest.

Thighs, shins, upper arms and forearms are brought exactly onto the file's bones, hands go with
forearms. Of trunk, head and feet the two builds are taken to be alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_PARENTS
from bridge.motion.directions import angle_deg, middle, shortest_turn, turn_deg, unit
from bridge.motion.skeletons import OWN_NAMES, SIDES, SkeletonMotion, plain_names, unusable

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
        f"{_side}_ankle": (f"{_side}_foot", _Z, 0.0),
        f"{_side}_foot": (None, _Z, 60.0),
        f"{_side}_collar": (f"{_side}_shoulder", _out, 60.0),
        f"{_side}_shoulder": (f"{_side}_elbow", _out, 110.0),
        f"{_side}_elbow": (f"{_side}_wrist", _out, 110.0),
        f"{_side}_wrist": (None, _out, 60.0),
    }
_LIMBS = ("hip", "knee", "shoulder", "elbow")
_SNAPPED_UP_DEG, _SNAPPED_SIDE_DEG, _SNAPPED_BONE_DEG = 25.0, 10.0, 40.0
_AGREED_DEG, _TILTED_DEG = 8.0, 10.0
_AGREED_SIDES_DEG, _TURNED_DEG = 3.0, 4.0
"""Where trunk and legs, or hips and shoulders, agree so well, what is farther from the file's axes
is a rest pose that is tilted or turned as a whole."""
_OPPOSITE_DEG = 90.0
"""Legs so far from below the trunk do not say where up is."""
_CUBE = [*Rotation.create_group("O").as_matrix()]
_OTHER_CHEST_DEG = 30.0
_OWN_DEG = dict.fromkeys(_LIMBS, 10.0) | {"ankle": 30.0}
"""SMPL's own limbs and feet at rest differ less between people."""
_AHEAD_DEG = 45.0
"""From where a limb may be turned about forward, to where it points forward itself."""
_FOOT_DEG = 55.0
_FOOT_SHAPE_DEG = 12.0, 50.0
"""Between the lines from ankle to toes and along them, in a flat foot."""
_STANCE = 0.25
"""Of a motion's frames, so many in which a foot surely stands."""
_CLEARLY_DEG = 15.0
"""By so much less a joint must turn in another quarter."""


def standing_up(skeleton: SkeletonMotion, joints: Mapping[str, int]) -> NDArray[np.float64] | None:
    """(3,) where the head is in the file's axes if it rests as somebody stands; else None."""
    rest = {name: skeleton.rest[joint] for name, joint in joints.items()}
    up = _pelvis(skeleton.path, rest) @ _Y
    trunk = middle(rest, "shoulder") - middle(rest, "hip")
    legs = [rest[f"{side}_ankle"] - rest[f"{side}_hip"] for side in SIDES]
    stands = angle_deg(trunk, up) < 45 and all(angle_deg(leg, -up) < 60 for leg in legs)
    return up if stands else None


class RestTurns:
    """What turns SMPL's rest pose into the frames of a file's joints, parents first.

    Parameters
    ----------
    joints : numbers of the file's joints by SMPL's names.
    sample : (S, J, 3, 3) rotations and (S, J, 3) places of the file's joints in some frames.
    up : (3,) vertical of the file's world.

    Attributes
    ----------
    rest_turns : (3, 3) R_j by the name of every joint of SMPL's that the file has.
    frames : the same before bones are brought onto the file's.
    feet : ankles that are taken to stand flat where they are lowest.
    """

    def __init__(
        self,
        skeleton: SkeletonMotion,
        joints: Mapping[str, int],
        smpl_rest_m: Rest,
        sample: tuple[NDArray, NDArray],
        up: NDArray,
    ) -> None:
        self.skeleton, self.joints, self.smpl_rest_m = skeleton, joints, smpl_rest_m
        self.turns, self.places = sample
        self.up = up
        rest = {name: skeleton.rest[joint] for name, joint in joints.items()}
        self.frames = {"pelvis": _pelvis(skeleton.path, rest)}
        self.rest_turns, self.feet = dict(self.frames), list[str]()
        self.chest = _chest_frame(skeleton, joints, rest)
        self.stands = standing_up(skeleton, joints) is not None
        self.is_smpls = self._rests_as_smpl()
        for name in OWN_NAMES[1:]:
            if name in joints:
                self._find(name)

    def _find(self, name: str) -> None:
        """One joint more."""
        above = OWN_NAMES[SMPL_PARENTS[OWN_NAMES.index(name)]]
        while above not in self.rest_turns:
            above = OWN_NAMES[SMPL_PARENTS[OWN_NAMES.index(above)]]
        end, along, most_deg = _BONES[name]
        frame, bone = self.frames[above], self._bone(name, end)
        is_limb = name.endswith(_LIMBS) and end is not None
        smpl_bone = self.smpl_rest_m[end] - self.smpl_rest_m[name] if is_limb and end else along
        if name == "spine3" and self.chest is not None:
            other = angle_deg(frame @ _X, self.chest @ _X) > _OTHER_CHEST_DEG
            frame = self.chest if other else frame
        if self.is_smpls:
            pass
        elif name.endswith("ankle") and bone is not None:
            frame = self._ankle(name, frame, bone)
        elif bone is None:
            kept = self.stands and above not in self.feet
            inherited = self.rest_turns[above] if name.endswith("wrist") else frame
            frame = inherited if kept else self._quietest(name, above, [inherited, *_CUBE])
        elif not self.stands or angle_deg(frame @ smpl_bone, bone) > most_deg:
            as_above = [frame] if along is _Y else []
            frame = self._quietest(name, above, [*as_above, *_swung(frame, along, bone)])
        self.frames[name] = self.rest_turns[name] = frame
        if is_limb and bone is not None and not self.is_smpls:
            self.rest_turns[name] = _onto(frame, smpl_bone, bone)

    def _rests_as_smpl(self) -> bool:
        """Whether it is taken as it is: it has SMPL's names, and rests as SMPL does."""
        if not set(plain_names(OWN_NAMES)) <= set(plain_names(self.skeleton.names)):
            return False
        for name, (end, *_) in _BONES.items():
            most_deg, bone = _OWN_DEG.get(name.rpartition("_")[2]), self._bone(name, end)
            if most_deg and end:
                own = self.smpl_rest_m[end] - self.smpl_rest_m[name]
                if bone is None or angle_deg(own, bone) > most_deg:
                    return False
        return True

    def _bone(self, name: str, end: str | None) -> NDArray[np.float64] | None:
        """(3,) from a joint to where its bone ends; None where that is not known."""
        if end is None or end not in self.joints:
            return None
        bone = self.skeleton.rest[self.joints[end]] - self.skeleton.rest[self.joints[name]]
        return bone if np.linalg.norm(bone) > 1e-9 else None

    def _quietest(self, name: str, above: str, turns: Sequence[NDArray]) -> NDArray[np.float64]:
        """The one with which the joint turns least throughout, or the first if none is clearly."""
        world = self.turns[:, self.joints[above]] @ self.rest_turns[above]
        local = self.turns[:, self.joints[name]]
        turned_deg = [turn_deg(world, local @ turn) for turn in turns]
        best = int(np.argmin(turned_deg))
        return turns[best if turned_deg[best] < turned_deg[0] - _CLEARLY_DEG else 0]

    def _ankle(self, name: str, frame: NDArray, bone: NDArray) -> NDArray[np.float64]:
        """As it stands on the floor, if it does not rest so."""
        toes = self.joints[f"{name.partition('_')[0]}_foot"]
        smpl_bone = self.smpl_rest_m[OWN_NAMES[OWN_NAMES.index(name) + 3]] - self.smpl_rest_m[name]
        if self.stands and angle_deg(frame @ smpl_bone, bone) < _FOOT_DEG:
            return frame
        flat = self.skeleton.tips.get(toes, self.skeleton.rest[toes]) - self.skeleton.rest[toes]
        least_deg, most_deg = _FOOT_SHAPE_DEG
        if self.stands and least_deg < angle_deg(flat, bone) < most_deg:
            return shortest_turn(frame @ _Z, flat) @ frame  # foot and toes as one piece
        self.feet.append(name)
        heights = self.places[:, toes] @ self.up
        lowest = self.turns[heights <= np.quantile(heights, _STANCE), self.joints[name]]
        sole = unit(np.median(np.swapaxes(lowest, -1, -2) @ self.up, axis=0))
        forward = bone - (bone @ sole) * sole
        forward = unit(
            forward if np.linalg.norm(forward) > 1e-9 else np.cross(sole, _X + sole[::-1])
        )
        return np.stack([np.cross(sole, forward), sole, forward], axis=1).astype(np.float64)


def leg_length(rest: Rest) -> float:
    """Of the left thigh and shin."""
    hip, knee, ankle = (rest[f"left_{name}"] for name in ("hip", "knee", "ankle"))
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def _pelvis(path: Path, rest: Rest) -> NDArray[np.float64]:
    """By trunk and legs: no single joint tells, the trunk's lowest may lie ahead of the hips."""
    hips, ankles = middle(rest, "hip"), middle(rest, "ankle")
    trunk, legs = unit(middle(rest, "shoulder") - hips), unit(hips - ankles)
    apart_deg = angle_deg(trunk, legs)
    both = trunk + legs if apart_deg < _OPPOSITE_DEG else trunk
    across = [rest[f"left_{pair}"] - rest[f"right_{pair}"] for pair in ("hip", "shoulder")]
    most_deg = _TILTED_DEG if apart_deg < _AGREED_DEG else _SNAPPED_UP_DEG
    frame = _frame([both, trunk], across, most_deg)
    if frame is None:
        raise unusable(path, "whose hips and trunk lie in one line at rest")
    return frame


def _frame(
    ups: Sequence[NDArray], across: Sequence[NDArray], most_deg: float
) -> NDArray[np.float64] | None:
    """(3, 3) left, up and forward as columns: along the file's own axes where they are near.

    None where left is up. `ups` are what up may be near, or else the first of them; `across` is
    left, and what else agrees with it if all is turned.
    """
    agreed = len(across) > 1 and angle_deg(*across) < _AGREED_SIDES_DEG
    left = _snapped(unit(across[0]), _TURNED_DEG if agreed else _SNAPPED_SIDE_DEG)
    up = unit(ups[0]) - (unit(ups[0]) @ left) * left
    if not np.linalg.norm(up) > 1e-6:
        return None
    level_deg = _TURNED_DEG if agreed else _SNAPPED_UP_DEG
    axes = [one for one in (*np.eye(3), *-np.eye(3)) if abs(angle_deg(one, left) - 90) < level_deg]
    lines = [*axes, *(np.cross(axis, left) for axis in axes)]
    far_deg = [min(angle_deg(line, one) for one in ups) for line in lines]
    if far_deg and min(far_deg) < most_deg:
        up = lines[int(np.argmin(far_deg))]
    up = unit(up)
    left = unit(left - (left @ up) * up)
    return np.stack([left, up, np.cross(left, up)], axis=1).astype(np.float64)


def _snapped(direction: NDArray, most_deg: float) -> NDArray[np.float64]:
    axis = np.zeros(3)
    number = int(np.abs(direction).argmax())
    axis[number] = np.sign(direction[number])
    return axis if angle_deg(direction, axis) < most_deg else direction


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
    across = rest[f"left_{pair}"] - rest[f"right_{pair}"]
    return _frame([rest["neck"] - rest["spine3"]], [across], _SNAPPED_UP_DEG)


def _onto(frame: NDArray, start: NDArray, bone: NDArray) -> NDArray[np.float64]:
    """The frame turned so that its `start` points as the bone: first about forward, as arms that
    hang in an A are, then the shortest way."""
    level = np.diag([1.0, 1.0, 0.0])
    ahead, end = frame @ level @ start, frame @ level @ (bone @ frame)
    if angle_deg(bone, end) > _AHEAD_DEG or angle_deg(ahead, end) > _OPPOSITE_DEG:
        return shortest_turn(frame @ start, bone) @ frame
    frame = shortest_turn(ahead, end) @ frame
    return shortest_turn(frame @ start, bone) @ frame


def _swung(frame: NDArray, along: NDArray, bone: NDArray) -> list[NDArray[np.float64]]:
    """The frame turned so that its axis `along` points as the bone, in each of four quarters."""
    start, end = frame @ along, frame @ _snapped(unit(bone @ frame), _SNAPPED_BONE_DEG)
    if angle_deg(start, end) > 179.0:
        axis = frame @ (_Z if abs(along @ _Z) < 0.5 else _X)
        swing = Rotation.from_rotvec(np.pi * unit(axis)).as_matrix()
    else:
        swing = shortest_turn(start, end)
    quarters = Rotation.from_rotvec(np.outer(np.arange(4) * np.pi / 2, end)).as_matrix()
    return [quarter @ swing @ frame for quarter in quarters]
