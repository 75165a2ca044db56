"""Eyes, brows, lips and short hair, by landmarks of the mesh that both bodies share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tools.skin.canvas import Canvas, within

# Vertices on the left: the socket's outer and inner corner; on the midline: upper lip's upper edge,
# between the lips, lower lip's lower edge, the hair line in front, the nose's tip, the crown.
_OUTER, _INNER = 6086, 6091
_UPPER, _BETWEEN, _LOWER, _HAIR_LINE, _NOSE, _CROWN = 85, 103, 92, 2837, 63, 265
_MOUTH_HALF_M = 0.0245
_EYE_HALF_M = (0.0145, 0.0062)
_IRIS_M, _PUPIL_M, _GLINT_M = 0.0056, 0.0025, 0.0009
WHITE, PUPIL, GLINT = (0.90, 0.87, 0.84), (0.05, 0.04, 0.04), (0.97, 0.97, 0.97)
_LASHES, _MOUTH_INSIDE = (0.16, 0.11, 0.09), (0.30, 0.13, 0.12)
# The hair line: degrees from the front, and height above the eyes as a part of the crown's.
_LINE = np.array([
    [0, 0.62], [22, 0.635], [40, 0.62], [50, 0.50], [58, 0.34], [65, 0.12], [70, 0.0],
    [75, -0.02], [79, 0.2], [84, 0.27], [103, 0.27], [109, 0.16], [118, -0.12], [138, -0.38],
    [160, -0.50], [180, -0.53],
])  # fmt: skip


@dataclass(frozen=True)
class Look:
    """Colours of a head, sRGB."""

    hair: ArrayLike
    iris: ArrayLike
    lips: ArrayLike
    brow_half_m: float
    """Half the height of the brows."""
    lip_amount: float


def paint_head(canvas: Canvas, look: Look) -> None:
    """Paint all of it on bare skin."""
    _paint_lips(canvas, look)
    _paint_eyes(canvas, look)
    _paint_hair(canvas, look)


def eye_m(canvas: Canvas) -> NDArray:
    """(3,) between the corners of the left eye."""
    return canvas.body.v_template[[_OUTER, _INNER]].mean(axis=0)


def _on_face(canvas: Canvas) -> NDArray:
    """(N,) 1 on the front of the head."""
    neck_m, eye = canvas.body.joints[15], eye_m(canvas)
    return within(neck_m[1] - 0.02 - canvas.y_m) * within(eye[2] - 0.045 - canvas.z_m)


def _paint_lips(canvas: Canvas, look: Look) -> None:
    upper, between, lower = (canvas.body.v_template[v] for v in (_UPPER, _BETWEEN, _LOWER))
    across = np.clip(np.abs(canvas.x_m) / _MOUTH_HALF_M, 0, 1)
    bow = 0.0008 * np.exp(-((canvas.x_m / 0.0035) ** 2))  # the dip of Cupid's bow
    arch = np.sqrt(1 - across**1.8)
    middle_m = between[1] - 0.0012 * across**2
    top_m = middle_m + (upper[1] - between[1]) * (1 - across**2) - bow
    bottom_m = middle_m - (between[1] - lower[1]) * 0.86 * arch
    beside_m = (np.abs(canvas.x_m) - _MOUTH_HALF_M) * 0.5
    outside_m = np.maximum(np.maximum(canvas.y_m - top_m, bottom_m - canvas.y_m), beside_m)
    front = _on_face(canvas)
    canvas.paint(look.lips, look.lip_amount * front * within(outside_m, 0.0022))
    seam = within(np.abs(canvas.y_m - middle_m) - 0.0007, 0.0011) * within(beside_m, 0.003)
    canvas.paint(_MOUTH_INSIDE, 0.75 * front * seam)


def _paint_eyes(canvas: Canvas, look: Look) -> None:
    """Looking ahead: seen from the front, as the sockets are hollow."""
    eye, front = eye_m(canvas), _on_face(canvas)
    x, y = np.abs(canvas.x_m) - eye[0], canvas.y_m - eye[1] - 0.0006
    half_x, half_y = _EYE_HALF_M
    y_tilted = y - 0.05 * x
    part = np.clip(1 - (x / half_x) ** 2, 0, 1)
    lid_m = np.where(y_tilted > 0, half_y, 0.62 * half_y) * part ** np.where(y > 0, 0.75, 0.9)
    outside_m = np.maximum(np.abs(y_tilted) - lid_m, 0.7 * (np.abs(x) - half_x))
    crease = np.exp(-(((y_tilted - lid_m - 0.0035) / 0.0022) ** 2)) * within(
        np.abs(x) - half_x, 0.004
    )
    canvas.darken(1 - 0.22 * front * crease * (y > 0))
    eyeball = front * within(outside_m, 0.0007)
    canvas.paint(WHITE, eyeball)
    canvas.darken(
        1
        - eyeball
        * (0.16 * (np.abs(x) / half_x) ** 2 + 0.28 * within(-y_tilted + 0.5 * half_y, 0.003))
    )
    radius_m = np.hypot(x, y_tilted - 0.0006)
    ring = np.clip(radius_m / _IRIS_M, 0, 1)
    iris = np.asarray(look.iris) * (1.15 - 0.55 * ring**4)[:, None]
    for colour, size_m in ((iris, _IRIS_M), (PUPIL, _PUPIL_M)):
        canvas.paint(colour, eyeball * within(radius_m - size_m, 0.0007))
    glint_m = np.hypot(canvas.x_m - np.sign(canvas.x_m) * eye[0] + 0.0018, y_tilted - 0.0026)
    canvas.paint(GLINT, eyeball * within(glint_m - _GLINT_M, 0.0006))
    lash = within(np.abs(outside_m) - 0.0005, 0.0008) * within(np.abs(x) - half_x - 0.001)
    canvas.paint(_LASHES, front * lash * np.where(y_tilted > 0, 0.9, 0.3))


def _paint_hair(canvas: Canvas, look: Look) -> None:
    crown, eye = canvas.body.v_template[_CROWN], eye_m(canvas)
    back_m = canvas.body.v_template[canvas.body.v_template[:, 1] > eye[1]][:, 2].min()
    middle_z = (canvas.body.v_template[_HAIR_LINE][2] + back_m) / 2
    ahead, aside = canvas.z_m - middle_z, np.abs(canvas.x_m)
    azimuth = np.degrees(np.arctan2(aside / 0.074, ahead / 0.09))
    line = np.interp(azimuth, *_LINE.T)
    height_m = (canvas.y_m - eye[1]) - line * (crown[1] - eye[1])
    ragged_m = 0.0011 * np.sin(0.55 * azimuth) + 0.0006 * np.sin(1.3 * azimuth + 1)
    on_head = within(canvas.body.joints[15][1] - 0.02 - canvas.y_m)
    amount = on_head * within(ragged_m - height_m, 0.007)
    shine = np.exp(-(((canvas.y_m - eye[1] - 0.72 * (crown[1] - eye[1])) / 0.022) ** 2))
    hair = np.asarray(look.hair) * (1 + 0.2 * shine)[:, None]
    canvas.paint(hair, amount)
    _paint_brows(canvas, look, eye)


def _paint_brows(canvas: Canvas, look: Look, eye: NDArray) -> None:
    along = (np.abs(canvas.x_m) - 0.0125) / 0.036  # 0 at the inner end, 1 at the outer
    inside = np.clip(along, 0, 1)
    height_m = eye[1] + 0.0145 + 0.0075 * np.sin(np.pi * (0.16 + 0.66 * inside))
    half_m = look.brow_half_m * (1 - inside**2.5) + 0.0004
    outside_m = np.maximum(
        np.abs(canvas.y_m - height_m) - half_m, 0.036 * (np.abs(along - 0.5) - 0.5)
    )
    canvas.paint(look.hair, 0.72 * _on_face(canvas) * within(outside_m, 0.0018))
