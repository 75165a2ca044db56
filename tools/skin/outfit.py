"""Plain sportswear: a top or a sleeveless shirt, and shorts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body.model_data import SMPL_JOINT_NAMES
from tools.skin.canvas import Canvas, ellipse_m, within

_EDGE_M = 0.006
"""Width of the darker band along a border."""


@dataclass(frozen=True)
class Outfit:
    """Sizes in metres, heights relative to joints; colours in sRGB."""

    top: ArrayLike
    shorts: ArrayLike
    trim: ArrayLike
    hem_above: tuple[str, float]
    """The top's lower border: a joint, and how far above it."""
    neck_m: tuple[float, float, float]
    """Half width of the neckline; its depth below the neck joint in front and behind."""
    armhole_m: tuple[float, float, float]
    """How far inside of the shoulder joint it reaches; half its height; how far below the joint
    its middle lies."""
    waist_m: float
    """Height of the waistband's upper border above the pelvis."""
    leg: float
    """Length of the legs as a part of the thighs."""


def paint_outfit(canvas: Canvas, outfit: Outfit) -> None:
    """Shorts, then the top over them."""
    shorts_m, leg_m = _shorts(canvas, outfit)
    _lay(canvas, outfit.shorts, shorts_m)
    below_m = joint(canvas, "pelvis")[1] + outfit.waist_m - canvas.y_m
    canvas.paint(outfit.trim, within(shorts_m) * within(np.abs(below_m - 0.015) - 0.015))
    _stripe(canvas, outfit, shorts_m, leg_m)
    _lay(canvas, outfit.top, _top(canvas, outfit))


def joint(canvas: Canvas, name: str) -> NDArray:
    return canvas.body.joints[SMPL_JOINT_NAMES.index(name)]


def _lay(canvas: Canvas, colour: ArrayLike, outside_m: NDArray) -> None:
    """Cloth, the darker edge of it, and its thin shadow on what is below."""
    canvas.darken(1 - 0.30 * within(outside_m - 0.003, 0.0035))
    canvas.paint(colour, within(outside_m))
    canvas.darken(1 - 0.14 * within(outside_m) * within(np.abs(outside_m + _EDGE_M) - 0.0008))


def _shorts(canvas: Canvas, outfit: Outfit) -> tuple[NDArray, NDArray]:
    """Signed distances to their border, and along the thighs from their hems, up."""
    hip, knee, pelvis = (joint(canvas, name) for name in ("left_hip", "left_knee", "pelvis"))
    thigh = (knee - hip) / np.linalg.norm(knee - hip)
    place = np.stack([np.abs(canvas.x_m), canvas.y_m, canvas.z_m], axis=1) - hip
    below_m = place @ thigh - outfit.leg * np.linalg.norm(knee - hip)
    above_m = canvas.y_m - pelvis[1] - outfit.waist_m
    arms_m = np.abs(canvas.x_m) - 0.45
    return np.maximum(np.maximum(below_m, above_m), arms_m), -below_m


def _stripe(canvas: Canvas, outfit: Outfit, shorts_m: NDArray, leg_m: NDArray) -> None:
    """Along the outer side of each leg."""
    hip = joint(canvas, "left_hip")
    outer = within(hip[0] + 0.02 - np.abs(canvas.x_m))
    band_m = np.abs(canvas.z_m - hip[2] - 0.004) - 0.011
    low = within(canvas.y_m - joint(canvas, "pelvis")[1] - outfit.waist_m + 0.03)
    canvas.paint(outfit.trim, within(shorts_m) * outer * within(band_m) * low * (leg_m > 0))


def _top(canvas: Canvas, outfit: Outfit) -> NDArray:
    """Signed distances to its border."""
    shoulder, neck = joint(canvas, "left_shoulder"), joint(canvas, "neck")
    name, above_m = outfit.hem_above
    aside = np.abs(canvas.x_m)
    reach, half, low = outfit.armhole_m
    middle_x = shoulder[0] + 0.03
    inward = np.minimum(aside - middle_x, 0)
    arm_m = ellipse_m(inward, canvas.y_m - shoulder[1] + low, middle_x - shoulder[0] + reach, half)
    arm_m = np.where(aside > middle_x, np.abs(canvas.y_m - shoulder[1] + low) - half, arm_m)
    half_x, front, back = outfit.neck_m
    behind = within(canvas.z_m - neck[2] - 0.005, 0.02)
    depth = front + behind * (back - front)
    neck_m = ellipse_m(canvas.x_m, np.minimum(canvas.y_m - neck[1], 0), half_x, depth)
    hem_m = joint(canvas, name)[1] + above_m - canvas.y_m
    return np.max([-arm_m, -neck_m, hem_m, canvas.y_m - neck[1] - 0.06], axis=0)
