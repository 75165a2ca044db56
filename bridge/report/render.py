"""Pictures of posed bodies on a white floor in soft light; equal arguments give equal pixels.

Light is known at the bodies' vertices and on a coarse grid of the floor (`light`), and what lies
between is interpolated. One ray a pixel finds the bodies, and more do along their outlines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.report.light import GRID_BORDER, GRID_STEP_PX, RayScene, light_on_bodies, light_on_floor

CLAY_SRGB = (0.86, 0.79, 0.73)
_OUTLINE_PX = 8.0
"""Where depth changes by more than so many pixels from one to the next, there is an outline."""
_BLOCK_PX = 8
_OUTLINE_RAYS = 8
_MARGIN = 0.04
_SCATTERED = (np.array([0, 4, 2, 6, 1, 5, 3, 7]) + 0.5) / 8
"""Heights of those rays in a pixel, from left to right: each eighth has one, both ways."""


@dataclass(frozen=True)
class Camera:
    """Where the pictures are taken from; one camera for all panels that are to be compared."""

    origin_m: tuple[float, float, float]
    target_m: tuple[float, float, float]
    """Point at the centre of the picture."""
    field_of_view_deg: float
    """Angle that the picture's width covers."""
    floor_m: float
    """Height of the floor, y up."""
    width_px: int
    height_px: int


def frame_camera(
    bodies: Sequence[ArrayLike],
    *,
    height_px: int,
    width_px: int | None = None,
    azimuth_deg: float = 20.0,
    elevation_deg: float = 8.0,
) -> Camera:
    """A camera that sees all of `bodies` (each (V, 3), metres, y up), on a floor below.

    The width fits the bodies when None; azimuth 0 looks along -z at the front of a body in its rest
    pose.
    """
    points = np.concatenate([np.asarray(body, dtype=np.float64) for body in bodies])
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    flat = np.cos(elevation)
    back = np.array([np.sin(azimuth) * flat, np.sin(elevation), np.cos(azimuth) * flat])
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    up = np.cross(back, right)
    seen = points @ np.stack([right, up, back], axis=1)
    low, high = seen.min(axis=0), seen.max(axis=0)
    centre, half = (low + high) / 2, (high - low) / 2 * (1 + 2 * _MARGIN)
    if width_px is None:
        width_px = max(64, int(np.ceil(height_px * half[0] / half[1])))
    # A long lens: bodies at the ends of a row keep their shape.
    distance = 9.0 * max(half[1], half[0] * height_px / width_px) + half[2]
    nearest = distance - half[2]
    half_width = max(half[0], half[1] * width_px / height_px)
    target = centre @ np.stack([right, up, back])
    x, y, z = target.tolist()
    from_x, from_y, from_z = (target + distance * back).tolist()
    return Camera(
        origin_m=(from_x, from_y, from_z),
        target_m=(x, y, z),
        field_of_view_deg=float(np.degrees(2 * np.arctan(half_width / nearest))),
        floor_m=float(points[:, 1].min()),
        width_px=width_px,
        height_px=height_px,
    )


def render_bodies(
    bodies: Sequence[ArrayLike],
    faces: ArrayLike,
    *,
    camera: Camera,
    colours: Sequence[ArrayLike | None] | None = None,
) -> NDArray[np.uint8]:
    """Picture (height, width, 3) in sRGB of bodies on a floor in soft light.

    Each body has vertices (V, 3), metres, y up, and perhaps `colours` (V, 3), sRGB in [0, 1]; clay
    where None. Faces (F, 3) are counter-clockwise from outside.
    """
    view = _View(camera)
    # About the target: far from the origin, single precision would be too coarse.
    surface = RayScene([np.asarray(body) - camera.target_m for body in bodies], np.asarray(faces))
    colours = [None] * len(bodies) if colours is None else colours
    painted = [
        np.broadcast_to(CLAY_SRGB if colour is None else colour, np.shape(body))
        for body, colour in zip(bodies, colours, strict=True)
    ]
    sent = srgb_to_linear(np.concatenate(painted)) * light_on_bodies(surface, view.back)[:, None]
    floor = view.floor_light(surface)
    picture = np.repeat(_tones(floor)[..., None], 3, axis=2)
    _draw_bodies(picture, floor, surface, sent.astype(np.float32), view)
    return picture


class _View:
    """A camera's rays, about its target."""

    def __init__(self, camera: Camera) -> None:
        self._floor_m = np.float32(camera.floor_m - camera.target_m[1])
        self._origin_m = np.subtract(camera.origin_m, camera.target_m)
        self.back = back = (self._origin_m / np.linalg.norm(self._origin_m)).astype(np.float32)
        """From the target to the camera."""
        right = np.cross([0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(back, right), back])
        self._size_px = np.array([camera.width_px, camera.height_px])
        self._px = 2 * np.tan(np.radians(camera.field_of_view_deg) / 2) / camera.width_px
        self.pixel_m = self._px * float(np.linalg.norm(self._origin_m))
        """Width of a pixel at the target."""

    def rays(self, x_px: NDArray, y_px: NDArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where rays (..., 3) through points of the picture begin, and their directions."""
        across = (x_px - self._size_px[0] / 2) * self._px
        along = (self._size_px[1] / 2 - y_px) * self._px
        right, up, back = self._axes.astype(np.float32)
        directions = np.multiply.outer(across.astype(np.float32), right) + (
            np.multiply.outer(along.astype(np.float32), up) - back
        )
        return np.broadcast_to(self._origin_m.astype(np.float32), directions.shape), directions

    def covered(self, surface: RayScene) -> NDArray[np.bool_]:
        """Those of (height, width) pixels that may show a body; none that does is left out."""
        seen = (surface.vertices - self._origin_m) @ self._axes.T
        places = seen[:, :2] / -seen[:, 2:] / self._px * [1, -1] + self._size_px / 2
        corners = np.clip(places // _BLOCK_PX, -1, self._size_px // _BLOCK_PX + 1).astype(int) + 1
        first, second, third = (corners[of] for of in surface.faces.T)
        left, top = np.minimum(np.minimum(first, second), third).T
        right, bottom = np.maximum(np.maximum(first, second), third).T + 1
        # Sums along both axes make a rectangle of ones of its four corners.
        shape = self._size_px[::-1] // _BLOCK_PX + 4
        signed = np.zeros(shape[0] * shape[1])
        for row, column, sign in (
            (top, left, 1),
            (bottom, right, 1),
            (top, right, -1),
            (bottom, left, -1),
        ):
            signed += sign * np.bincount(row * shape[1] + column, minlength=signed.size)
        blocks = signed.reshape(shape).cumsum(axis=0).cumsum(axis=1)[1:-2, 1:-2] > 0
        width, height = self._size_px
        return blocks.repeat(_BLOCK_PX, axis=0).repeat(_BLOCK_PX, axis=1)[:height, :width]

    def floor_light(self, surface: RayScene) -> NDArray[np.float32]:
        """(height, width) light of the floor, which fills the picture."""
        height, width = -(-self._size_px[::-1] // GRID_STEP_PX) + 2 * GRID_BORDER
        y = (np.arange(height)[:, None] - GRID_BORDER) * GRID_STEP_PX[0]
        x = (np.arange(width) - GRID_BORDER) * GRID_STEP_PX[1]
        origins, directions = self.rays(*np.broadcast_arrays(x, y))
        # Where a ray does not go down, it is the white beyond the floor's end.
        far = (self._floor_m - origins[..., 1]) / np.minimum(directions[..., 1], -1e-6)
        points = origins + far[..., None] * directions
        light = light_on_floor(surface, points)
        for axis, (size, step) in enumerate(zip(self._size_px[::-1], GRID_STEP_PX, strict=True)):
            place = (np.arange(size) + 0.5) / step + GRID_BORDER
            before, part = place.astype(int), (place % 1).astype(np.float32)
            part = part[:, None] if axis == 0 else part
            light = light.take(before, axis) * (1 - part) + light.take(before + 1, axis) * part
        return light


def _draw_bodies(
    picture: NDArray[np.uint8],
    floor: NDArray[np.float32],
    surface: RayScene,
    sent: NDArray[np.float32],
    view: _View,
) -> None:
    """Add bodies whose vertices send light (V, 3) to a picture of the floor."""
    y, x = np.nonzero(view.covered(surface))
    far = np.full(floor.shape, np.inf, np.float32)
    far[y, x], light = surface.seen(*view.rays(x + 0.5, y + 0.5), sent)
    picture[np.isfinite(far)] = _tones(light)
    y, x = np.nonzero(_outline(far, _OUTLINE_PX * view.pixel_m))
    across = (np.arange(_OUTLINE_RAYS) + 0.5) / _OUTLINE_RAYS
    apart, light = surface.seen(*view.rays(x[:, None] + across, y[:, None] + _SCATTERED), sent)
    mixed = np.tile(floor[y, x][:, None, None], (1, _OUTLINE_RAYS, 3))
    mixed[np.isfinite(apart)] = light
    picture[y, x] = _tones(np.minimum(mixed, 1).mean(axis=1))


def _outline(far: NDArray[np.float32], step: float) -> NDArray[np.bool_]:
    """Those of (H, W) pixels that a neighbour lies before or behind."""
    found = np.zeros(far.shape, bool)
    far = np.where(np.isfinite(far), far, -1e9)
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        apart = np.abs(far[one] - far[other]) > step
        found[one] |= apart
        found[other] |= apart
    return found


def srgb_to_linear(colour: ArrayLike) -> NDArray[np.float64]:
    """Linear light of sRGB values in [0, 1]."""
    srgb = np.clip(np.asarray(colour, dtype=np.float64), 0.0, 1.0)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: ArrayLike) -> NDArray[np.float64]:
    """The inverse of `srgb_to_linear`; light beyond [0, 1] is clipped."""
    linear = np.clip(np.asarray(light, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def _tones(light: NDArray) -> NDArray[np.uint8]:
    """sRGB values of linear light, which is clipped to [0, 1]."""
    return _TONES[(np.clip(light, 0, 1) * np.float32(len(_TONES) - 1)).astype(np.int16)]


_TONES = np.round(255 * linear_to_srgb(np.linspace(0, 1, 1 << 14))).astype(np.uint8)
