"""Which joint of a BVH skeleton is which of SMPL's: by the names that programs give them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion.bvh_file import BvhFile, unusable
from bridge.paper import N_JOINTS

SIDES = ("left", "right")
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


def joints_by_name(bvh: BvhFile) -> dict[str, int]:
    """Number of the file's joint for each of SMPL's 22 that it has.

    Raises
    ------
    DsnetError
        If one is missing without which there is no pose.
    """
    free = {plain_name(name): number for number, name in reversed([*enumerate(bvh.names)])}
    found: dict[str, int] = {}
    for name, calls in _OF_THE_MIDDLE.items():
        _take(name, calls, free, found)
    for name, calls in _OF_A_SIDE.items():
        for side in SIDES:
            _take(f"{side}_{name}", [side[0] + call for call in calls], free, found)
    needed = [
        name
        for name in SMPL_JOINT_NAMES[:N_JOINTS]
        if name.removeprefix("left_").removeprefix("right_") not in _MAY_LACK
    ]
    if missing := [name for name in needed if name not in found]:
        raise unusable(
            bvh.path,
            f"whose skeleton has no {', '.join(missing)} (it has {', '.join(bvh.names)[:200]})",
            "Rename its joints as SMPL or Mixamo do.",
        )
    return found | _spine(bvh, found)


def plain_name(name: str) -> str:
    """`mixamorig:LeftUpLeg`, `upleg.L` and `L_UpLeg` as `lupleg`."""
    name = name.rpartition(":")[2]
    name = re.sub(r"^([mf]_avg_|mixamorig\d*_?|bip\d*[ _]?)", "", name, flags=re.IGNORECASE)
    if of_side := re.fullmatch(r"(.+)[._ ](l|r|left|right)", name, flags=re.IGNORECASE):
        name = of_side[2] + of_side[1]
    return re.sub(r"^(l|r)(eft|ight)", r"\1", re.sub(r"[^a-z0-9]", "", name.lower()))


def _take(name: str, calls: Sequence[str], free: dict[str, int], found: dict[str, int]) -> None:
    call = next((call for call in calls if call in free), None)
    if call is not None:
        found[name] = free.pop(call)


def _spine(bvh: BvhFile, found: Mapping[str, int]) -> dict[str, int]:
    """Of the joints between pelvis and neck the lowest, the middle and the highest."""
    top = found.get("neck", found.get("head", found["left_shoulder"]))
    between: list[int] = []
    joint = bvh.parents[top]
    while joint >= 0 and joint != found["pelvis"]:
        between.insert(0, joint)
        joint = bvh.parents[joint]
    between = [joint for joint in between if joint not in found.values()]
    if not between:
        return {}
    if len(between) == 1:
        return {_SPINE[1]: between[0]}
    if len(between) == 2:
        return {_SPINE[0]: between[0], _SPINE[2]: between[1]}
    return dict(zip(_SPINE, (between[0], between[len(between) // 2], between[-1]), strict=True))
