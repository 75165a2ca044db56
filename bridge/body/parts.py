"""Parts of the body as weights of vertices, so that what is done to one fades into the next.

Limbs are the joints that move the skin; the trunk is divided by height and into front and back.
Everything is taken from the body model, so any SMPL body has the same parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData

_OF_JOINTS = {
    "head": ("neck", "head"),
    "upper_arms": ("left_shoulder", "right_shoulder"),
    "forearms": ("left_elbow", "right_elbow"),
    "hands": ("left_wrist", "right_wrist"),
    "thighs": ("left_hip", "right_hip"),
    "calves": ("left_knee", "right_knee"),
    "feet": ("left_ankle", "right_ankle", "left_foot", "right_foot"),
}
PARTS = (
    "head", "chest", "belly", "back", "buttocks", "upper_arms", "forearms", "hands", "thighs",
    "calves", "feet",
)  # fmt: skip
GROUPS = {
    "torso": ("chest", "belly", "back", "buttocks"),
    "arms": ("upper_arms", "forearms", "hands"),
    "legs": ("thighs", "calves", "feet"),
}
"""Several parts under one name."""
# Heights of borders: what part of the way from one joint to another.
_BELOW_CHEST = ("spine2", "spine3", 0.3)
_ABOVE_BUTTOCKS = ("pelvis", "spine1", 0.5)
_BELOW_BUTTOCKS = ("left_hip", "left_knee", 0.2)
_FADE = 0.025
"""Half the width of a border, as a part of the body's height."""


def part_weights(body: BodyModelData) -> NDArray[np.float64]:
    """(V, 11) how much each vertex belongs to each of `PARTS`: 0 to 1, rows sum to one."""
    weights = body.body_weights.T / body.weights.sum(axis=1)
    skin = dict(zip(SMPL_JOINT_NAMES, weights, strict=False))
    parts = {
        name: np.sum([skin[joint] for joint in joints], axis=0)
        for name, joints in _OF_JOINTS.items()
    }
    trunk = 1.0 - np.sum(list(parts.values()), axis=0)
    front = _front(body, trunk)
    # Skinning gives the seat to the thighs.
    seat = parts["thighs"] * _above(body, *_BELOW_BUTTOCKS) * (1 - front)
    parts["thighs"] = parts["thighs"] - seat
    high, waist = _above(body, *_BELOW_CHEST), _above(body, *_ABOVE_BUTTOCKS)
    parts["chest"] = trunk * front * high
    parts["belly"] = trunk * front * (1 - high)
    parts["back"] = trunk * (1 - front) * waist
    parts["buttocks"] = trunk * (1 - front) * (1 - waist) + seat
    weights = np.clip(np.stack([parts[name] for name in PARTS], axis=1), 0.0, 1.0)
    return weights / weights.sum(axis=1, keepdims=True)


def _front(body: BodyModelData, trunk: NDArray) -> NDArray[np.float64]:
    """(V,) 1 before the trunk's middle, 0 behind it."""
    depth_m = body.v_template[:, 2]
    return _smooth_step((depth_m - np.average(depth_m, weights=trunk)) / _fade_m(body))


def _above(body: BodyModelData, lower: str, upper: str, part: float) -> NDArray[np.float64]:
    """(V,) 1 above, 0 below a part of the way from one joint's height to another's."""
    one, two = (body.joints[SMPL_JOINT_NAMES.index(name), 1] for name in (lower, upper))
    return _smooth_step((body.v_template[:, 1] - (1 - part) * one - part * two) / _fade_m(body))


def _fade_m(body: BodyModelData) -> float:
    return _FADE * float(np.ptp(body.v_template[:, 1]))


def _smooth_step(x: NDArray) -> NDArray[np.float64]:
    """From 0 at -1 to 1 at 1, level at both."""
    t = np.clip((x + 1) / 2, 0.0, 1.0)
    return t * t * (3 - 2 * t)
