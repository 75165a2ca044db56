"""A skeleton that moves, as a file has it, and which of its joints are SMPL's.

Names are compared without what all joints of a file begin or end with, without blanks and signs,
and with their side in front: `mixamorig:LeftUpLeg`, `J_Bip_L_UpperLeg`, `upleg.L` and `l_upleg_jnt`
are `lupleg` or `lupperleg`. Pelvis, neck and spine have many names and one place: they are placed
between hips, shoulders and head.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError, did_you_mean
from bridge.paper import N_JOINTS
from bridge.runs.untrusted import damage_refused, open_regular

SIDES = ("left", "right")
OWN_NAMES = SMPL_JOINT_NAMES[:N_JOINTS]
_OF_A_SIDE = {
    "hip": ("hip", "upleg", "thigh", "thighbend", "upperleg", "femur", "leg"),
    "knee": ("knee", "leg", "shin", "lowleg", "lowerleg", "calf", "tibia"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "toe0", "ball", "foot"),
    "shoulder": ("arm", "upperarm", "uparm", "uarm", "humerus", "shldrbend", "shoulder", "shldr"),
    "elbow": ("elbow", "forearm", "forearmbend", "lowarm", "lowerarm", "farm", "radius"),
    "wrist": ("wrist", "hand"),
    "collar": ("collar", "clavicle", "shoulder", "shoulder1"),
}
"""How files call a joint, best first; each of theirs is taken once, in this order. What is a foot
or a shoulder depends on whether there is an ankle or an arm beside it."""
_OF_THE_MIDDLE = {
    "pelvis": ("pelvis", "hips", "hip"),
    "neck": ("neck", "neck1", "neck01", "lowerneck", "necklower"),
    "head": ("head",),
    "spine1": ("abdomenupper",),
}
_PART = "jnt|joint|jt|bone|bn|bind|skin|def|drv|env"
"""In names of rigs: what a joint is for, and not which it is."""
_SIDE_ENDS = "(?:f|ft|t|gt|ght)?"
_PLAIN = [
    (re.compile(part), put)
    for part, put in (
        (rf"(?:^|[_. -]+)(?:{_PART})(?=$|[_. -])", ""),
        (r"^[_. -]+|[_. -]+$", ""),
        (r"^(?:c|m|center|centre)[_. ]", ""),
        (rf"^(l|r){_SIDE_ENDS}[_. -]", r"\1"),
        (rf"^(?:(.+)[._ -](l|r){_SIDE_ENDS}|(.+?)[._ -]?(left|right))$", r"\2\4\1\3"),
        (r"[^a-z0-9]", ""),
        (r"^(l|r)(?:eft|ight)", r"\1"),
    )
]
"""What becomes of a name in small letters, one after another."""
_SPINE = ("spine1", "spine2", "spine3")
_MAY_LACK = {"collar", "foot", "head", "neck", *_SPINE}
_SHARED = 0.8
"""Of a file's joints, those that begin or end alike."""
_SHARED_PARTS = [
    re.compile(part, re.IGNORECASE)
    for part in (
        r"^[^_. -]+[_. -]+", r"[_. -]+[^_. -]+$", rf"^(?:{_PART})[_. -]*", rf"[_. -]*(?:{_PART})$"
    )
]  # fmt: skip
_FRAMES_AT_ONCE = 2048
_MOST_MAP_BYTES = 1 << 16


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
    """nan where the file does not say."""
    tips: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)
    """(3,) by joint that ends somewhere: where, as `rest`."""
    notes: tuple[str, ...] = ()
    """Notes about the file, a line each."""

    def posed(self, frames: slice | NDArray[np.intp]) -> tuple[NDArray, NDArray]:
        """Rotations (B, J, 3, 3) and places (B, J, 3) of the joints in the file's world."""
        angles = self.angles_rad[frames]
        turns, places = np.empty((*angles.shape[:2], 3, 3)), np.empty(angles.shape)
        for joint, (parent, axes) in enumerate(zip(self.parents, self.axes, strict=True)):
            turn = Rotation.from_euler(axes, angles[:, joint]).as_matrix()
            if parent < 0:
                turns[:, joint], places[:, joint] = turn, self.root[frames]
                continue
            turns[:, joint] = turns[:, parent] @ turn
            bone = np.broadcast_to(self.rest[joint] - self.rest[parent], (len(angles), 3))
            bone = self.places[joint][frames] if joint in self.places else bone
            moved = np.einsum("txy,ty->tx", turns[:, parent], bone)
            places[:, joint] = places[:, parent] + moved
        return turns, places

    def above(self, joint: int) -> list[int]:
        """Its parent, and on to the root."""
        parent = self.parents[joint]
        return [] if parent < 0 else [parent, *self.above(parent)]

    def blocks(self) -> Iterator[tuple[slice, NDArray[np.float64], NDArray[np.float64]]]:
        """All frames in pieces, each with what `posed` gives of it."""
        for start in range(0, len(self.root), _FRAMES_AT_ONCE):
            frames = slice(start, min(start + _FRAMES_AT_ONCE, len(self.root)))
            yield frames, *self.posed(frames)

    def mirrored(self, axis: int) -> SkeletonMotion:
        """The same with one axis the other way round."""
        sign = np.ones(3)
        sign[axis] = -1.0
        about = np.array([["XYZ".index(letter) for letter in axes] for axes in self.axes])
        return replace(
            self,
            rest=self.rest * sign,
            root=self.root * sign,
            angles_rad=self.angles_rad * -sign[about],
            places={joint: places * sign for joint, places in self.places.items()},
            tips={joint: tip * sign for joint, tip in self.tips.items()},
        )


def unusable(path: Path, flaw: str, remedy: str = "") -> DsnetError:
    """The line that says why a file is refused."""
    usual = "Export it with three rotations on every joint, and three positions on the root."
    return DsnetError(f"{path}, {flaw}", "a motion of a person's skeleton", remedy or usual)


def joints_by_name(skeleton: SkeletonMotion, joint_map: Mapping[str, str]) -> dict[str, int]:
    """Number of the file's joint for each of SMPL's 22 that it has.

    `joint_map` is the user's, the file's name by SMPL's: it counts more than what names say.
    """
    calls_of = dict(_OF_THE_MIDDLE)
    for name, calls in _OF_A_SIDE.items():
        for side in SIDES:
            calls_of[f"{side}_{name}"] = tuple(side[0] + call for call in calls)
    joints = {name: _mapped(skeleton, name, theirs) for name, theirs in joint_map.items()}
    names = reversed([*enumerate(plain_names(skeleton.names))])
    free = {plain: number for number, plain in names if number not in joints.values()}
    for name, calls in calls_of.items():
        call = next((call for call in calls if call in free), None)
        if name not in joints and call is not None:
            joints[name] = free.pop(call)
    _by_place(skeleton, joints)
    needed = [
        n for n in OWN_NAMES if n.removeprefix("left_").removeprefix("right_") not in _MAY_LACK
    ]
    if missing := [name for name in needed if name not in joints]:
        has = ", ".join(skeleton.names)[:200]
        raise unusable(
            skeleton.path,
            f"whose skeleton has no {', '.join(missing)} (it has {has})",
            "Say which they are by --joint-map, or rename them as SMPL or Mixamo do.",
        )
    return _spine(skeleton, joints) | joints


def _mapped(skeleton: SkeletonMotion, name: str, theirs: str) -> int:
    for received, names in ((name, OWN_NAMES), (theirs, skeleton.names)):
        if received not in names:
            remedy = did_you_mean(received, names, "Correct the joint map.")
            raise DsnetError(f"a joint map with {received!r}", ", ".join(names)[:300], remedy)
    return skeleton.names.index(theirs)


def read_joint_map(path: Path) -> dict[str, str]:
    """The file's joints by SMPL's names: `left_hip = Bip01 L Thigh` a line, `#` before remarks."""

    def refused(error: Exception) -> DsnetError:
        return DsnetError(
            f"--joint-map {path}, {str(error)[:200]}",
            "lines such as left_hip = LeftUpLeg",
            "Correct it, or leave --joint-map out.",
        )

    with damage_refused(refused), open_regular(path, _MOST_MAP_BYTES) as file:
        lines = file.read().decode("utf-8-sig").splitlines()
        joint_map: dict[str, str] = {}
        for line in lines:
            name, equals, theirs = (part.strip() for part in line.partition("="))
            if name and not name.startswith("#"):
                if not equals or not theirs or name in joint_map:
                    raise ValueError(f"with the line {line[:80]!r}")
                joint_map[name] = theirs
        return joint_map


def plain_names(names: tuple[str, ...]) -> list[str]:
    """Each as small letters and digits, its side in front as one letter."""
    left, shared = [name.rpartition(":")[2] for name in names], True
    while shared:
        shared = False
        for pattern in _SHARED_PARTS:
            found = [match[0] if (match := pattern.search(name)) else "" for name in left]
            part, count = Counter(filter(None, found)).most_common(1)[0] if any(found) else ("", 0)
            if count >= max(_SHARED * len(left), 2):
                shared = True
                left = [
                    pattern.sub("", name) if its == part else name
                    for name, its in zip(left, found, strict=True)
                ]
    return [_plain(name) for name in left]


def _plain(name: str) -> str:
    name = name.lower()
    for pattern, put in _PLAIN:
        name = pattern.sub(put, name)
    return name


def _by_place(skeleton: SkeletonMotion, joints: dict[str, int]) -> None:
    """Pelvis and neck where no name says: above both hips, and below the head."""

    def line(joint: int) -> list[int]:
        return [*reversed(skeleton.above(joint)), joint]

    def parting(name: str) -> list[int]:
        """From the root to where the two sides part."""
        lines = [line(joints[f"{side}_{name}"]) for side in SIDES]
        return [one for one, other in zip(*lines, strict=False) if one == other]

    if "pelvis" not in joints and {"left_hip", "right_hip"} <= joints.keys():
        above = [joint for joint in parting("hip") if joint not in joints.values()]
        joints |= {"pelvis": above[-1]} if above else {}
    if "neck" not in joints and {"head", "left_shoulder", "right_shoulder"} <= joints.keys():
        below = set(parting("shoulder"))
        neck = [joint for joint in line(joints["head"])[:-1] if joint not in below]
        joints |= {"neck": neck[0]} if neck else {}


def _spine(skeleton: SkeletonMotion, joints: Mapping[str, int]) -> dict[str, int]:
    """Of the joints between pelvis and neck the lowest, the middle and the highest."""
    joint = skeleton.parents[joints.get("neck", joints.get("head", joints["left_shoulder"]))]
    between: list[int] = []
    below = {joints["pelvis"], *skeleton.above(joints["pelvis"])}
    while joint >= 0 and joint not in below:
        between.insert(0, joint)
        joint = skeleton.parents[joint]
    between = [joint for joint in between if joint not in joints.values()]
    if len(between) > len(_SPINE):  # a first one in the pelvis is its second frame
        lowest, pelvis = skeleton.rest[between[0]], skeleton.rest[joints["pelvis"]]
        between = between[1:] if np.allclose(lowest, pelvis) else between
    if not between:
        return {}
    if len(between) == 1:
        return {_SPINE[1]: between[0]}
    if len(between) == 2:
        return {_SPINE[0]: between[0], _SPINE[2]: between[1]}
    return dict(zip(_SPINE, (between[0], between[len(between) // 2], between[-1]), strict=True))
