"""Pictures of posed bodies on a white floor in soft light; equal arguments give equal pixels.

A broad lamp and a bright sky light the scene. How much of either reaches a place is found by rays
in fixed directions at the bodies' vertices and on a coarse grid of the floor, and what lies between
is interpolated: no grain, and nothing flickers from picture to picture. One ray a pixel finds the
bodies, and more do along their outlines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.ndimage import gaussian_filter

from bridge.body.surface_operators import vertex_normals
from bridge.errors import DsnetError

CLAY_SRGB = (0.86, 0.79, 0.73)
_MARGIN = 0.04
_LAMP = np.array([-0.5, 1.0, 0.75]) / np.linalg.norm([-0.5, 1.0, 0.75])
"""From the bodies to the middle of the lamp, a ball."""
_LAMP_RADIUS = 0.5
# Light that a white surface sends back: of the lamp if it faces it, of the surroundings if it
# looks to the side, and how much more if it looks up.
_KEY, _AROUND, _ABOVE = 0.6, 0.5, 0.08
# Rays of a place to lamp and surroundings; so many neighbours have different ones; how often their
# means are taken.
_KEY_RAYS, _AROUND_RAYS, _TURNS, _SMOOTHED = 5, 5, 6, 4
# An unshaded floor is a shade brighter than the paper around the picture: both clip to white.
_FLOOR, _FLOOR_KEY, _FLOOR_RAYS, _FLOOR_TILE, _FLOOR_BLUR = 1.08, 0.63, 6, 4, 1.8
_GRID_PX, _BORDER = 4, 4
"""Pixels between points where the floor's light is found; more of them around the picture."""
_LIFT_M, _AWAY = 1e-3, -0.3
_OUTLINE_PX = 8.0
"""Where depth changes by more than so many pixels from one to the next, there is an outline."""
_NOWHERE_M = np.float32(-1e9)
_SCATTERED = (np.array([[0, 1, 2, 3, 4, 5, 6, 7], [0, 4, 2, 6, 1, 5, 3, 7]]) + 0.5) / 8
"""Places of an outline's rays in a pixel: each eighth of its width, and of its height, has one."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Where the pictures are taken from; one camera for all panels that are to be compared."""

    target_m: NDArray[np.float64]
    """(3,) point at the centre of the picture, about which rays are given."""
    away_m: NDArray[np.float64]
    """(3,) from the target to the camera."""
    axes: NDArray[np.float64]
    """(3, 3) right, up and back."""
    pixel: float
    """Width of a pixel at unit distance."""
    floor_m: float
    """Height of the floor, y up."""
    width_px: int
    height_px: int

    def rays(self, x_px: NDArray, y_px: NDArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where rays (..., 3) through points of the picture begin, and their directions."""
        across = (x_px - self.width_px / 2) * self.pixel
        along = (self.height_px / 2 - y_px) * self.pixel
        right, up, back = self.axes.astype(np.float32)
        directions = np.multiply.outer(across.astype(np.float32), right) + (
            np.multiply.outer(along.astype(np.float32), up) - back
        )
        return np.broadcast_to(self.away_m.astype(np.float32), directions.shape), directions

    def pixels_about(self, points: NDArray) -> tuple[slice, slice]:
        """Rows and columns of the picture among which points (N, 3) lie."""
        x, y, away = ((points - self.away_m) @ self.axes.T).T
        size_px = np.array([self.height_px, self.width_px])
        places = size_px[:, None] / 2 - np.stack([y, -x]) / -away / self.pixel
        first = np.clip(places.min(axis=1).astype(int) - 1, 0, size_px)
        last = np.clip(places.max(axis=1).astype(int) + 2, 0, size_px)
        return slice(first[0], last[0]), slice(first[1], last[1])


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
    axes = np.stack([right, np.cross(back, right), back])
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    centre, half = (low + high) / 2, (high - low) / 2 * (1 + 2 * _MARGIN)
    if width_px is None:
        width_px = max(64, int(np.ceil(height_px * half[0] / half[1])))
    # A long lens: bodies at the ends of a row keep their shape.
    distance = 9.0 * max(half[1], half[0] * height_px / width_px) + half[2]
    half_width = max(half[0], half[1] * width_px / height_px)
    return Camera(
        target_m=centre @ axes,
        away_m=distance * back,
        axes=axes,
        pixel=float(2 * half_width / (distance - half[2]) / width_px),
        floor_m=float(points[:, 1].min()),
        width_px=width_px,
        height_px=height_px,
    )


def render_bodies(
    bodies: Sequence[ArrayLike],
    faces: ArrayLike,
    *,
    camera: Camera,
    colours: Sequence[ArrayLike | None],
) -> NDArray[np.uint8]:
    """Picture (height, width, 3) in sRGB of bodies on a floor in soft light.

    Each body has vertices (V, 3), metres, y up, and perhaps `colours` (V, 3), sRGB in [0, 1]; clay
    where None. Faces (F, 3) are counter-clockwise from outside.
    """
    # About the target: far from the origin, single precision would be too coarse.
    surface = _Surface([np.asarray(body) - camera.target_m for body in bodies], np.asarray(faces))
    painted = [
        np.broadcast_to(CLAY_SRGB if colour is None else colour, np.shape(body))
        for body, colour in zip(bodies, colours, strict=True)
    ]
    sent = srgb_to_linear(np.concatenate(painted)) * _light_on(surface, camera.axes[2])[:, None]
    sent = sent.astype(np.float32)
    floor = np.repeat(_light_on_floor(surface, camera)[..., None], 3, axis=2)
    light, depth = floor.copy(), np.full(floor.shape[:2], _NOWHERE_M)
    about = camera.pixels_about(surface.vertices)
    y, x = np.mgrid[about]
    hit, depth[about], seen = surface.seen(*camera.rays(x + 0.5, y + 0.5), sent)
    light[about][hit] = seen
    step_m = _OUTLINE_PX * camera.pixel * float(np.linalg.norm(camera.away_m))
    y, x = np.nonzero(_outline(depth, step_m))
    across, down = _SCATTERED
    hit, _, seen = surface.seen(*camera.rays(x[:, None] + across, y[:, None] + down), sent)
    mixed = np.repeat(floor[y, x][:, None], len(across), axis=1)
    mixed[hit] = seen
    light[y, x] = np.minimum(mixed, 1).mean(axis=1)
    return _TONES[(np.clip(light, 0, 1) * np.float32(len(_TONES) - 1)).astype(np.int16)]


class _Surface:
    """All bodies of a picture, vertices (V, 3) of each, metres, y up, to be hit by rays."""

    def __init__(self, bodies: Sequence[NDArray], faces: NDArray) -> None:
        first = np.cumsum([0, *map(len, bodies[:-1])])
        self.vertices = np.concatenate(bodies).astype(np.float32)
        self.faces = np.concatenate([faces + start for start in first]).astype(np.int32)
        self._scene = _embree_scene(self.vertices, self.faces)

    def seen(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], sent: NDArray
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray]:
        """Which rays (..., 3) meet a body, how far they come (...), `_NOWHERE_M` if they meet none,
        and what arrives by them (M, 3).

        `sent` (V, 3) is what each vertex sends, and faces what lies between their corners'.
        """
        rays = (one.reshape(-1, 3) for one in (origins, directions))
        met = self._scene.run(*rays, query="INTERSECT", output=True)
        hit = met["primID"] >= 0
        corners = self.faces[met["primID"][hit]]
        u, v = met["u"][hit, None], met["v"][hit, None]
        arrives = sent[corners[:, 0]] * (1 - u - v)
        arrives += sent[corners[:, 1]] * u
        arrives += sent[corners[:, 2]] * v
        shape = origins.shape[:-1]
        far = np.where(hit, met["tfar"], _NOWHERE_M)
        return hit.reshape(shape), far.reshape(shape), arrives

    def reached(self, points: NDArray, normals: NDArray, rays: NDArray) -> NDArray[np.float32]:
        """(2, N) what falls by rays (N, R, 3) on points that look along normals (N, 3), if nothing
        were in the way; and what arrives."""
        falls = np.maximum(np.einsum("nx,nrx->nr", normals, rays), 0)
        point, ray = np.nonzero(falls)
        start = (points + _LIFT_M * normals)[point].astype(np.float32)
        hidden = self._scene.run(start, rays[point, ray], query="OCCLUDED") >= 0
        arrives = falls.copy()
        arrives[point[hidden], ray[hidden]] = 0
        return np.stack([falls.sum(axis=1), arrives.sum(axis=1)])


def _embree_scene(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> Any:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ModuleNotFoundError as error:
        raise DsnetError(
            "a picture of bodies without embreex, which has no wheel for this system",
            "Linux on x86-64, macOS or Windows",
            "Predict with --write offsets,vertices, or build embreex from its sources.",
        ) from error
    scene = EmbreeScene()
    TriangleMesh(scene, vertices, faces)
    return scene


def _light_on(surface: _Surface, towards: NDArray) -> NDArray[np.float32]:
    """(V,) light that the vertices would send back if they were white.

    Those that look away from the direction `towards` (3,) send none, as no picture shows them.
    """
    normals = vertex_normals(surface.vertices, surface.faces).astype(np.float32)
    looking = np.flatnonzero(normals @ towards > _AWAY)
    lamp, around = _lamp(_TURNS * _KEY_RAYS), _sphere(_TURNS * _AROUND_RAYS)
    sums = np.zeros((len(normals), 4), np.float32)
    for column, rays in ((0, lamp), (2, around)):
        turned = np.stack([rays[turn::_TURNS] for turn in range(_TURNS)])[looking % _TURNS]
        found = surface.reached(surface.vertices[looking], normals[looking], turned)
        sums[looking, column : column + 2] = found.T
    corners, starts = surface.faces.ravel(), np.arange(0, surface.faces.size + 1, 3)
    of_faces = sparse.csr_array((np.ones_like(corners, np.float32), corners, starts))
    for _ in range(_SMOOTHED):
        sums = of_faces.T @ (of_faces @ sums)
    # The share that arrives is smooth over the surface; what falls on it follows its shape.
    key, open_to = (sums[:, 1::2] / np.maximum(sums[:, ::2], np.float32(1e-9))).T
    key = key * np.maximum(normals @ lamp.T, 0).mean(axis=1)
    return _KEY * key + (_AROUND + _ABOVE * normals[:, 1]) * open_to


def _light_on_floor(surface: _Surface, camera: Camera) -> NDArray[np.float32]:
    """(height, width) light that a white floor sends back, which fills the picture."""
    size_px = np.array([camera.height_px, camera.width_px])
    rows, columns = -(-size_px // _GRID_PX) + 2 * _BORDER
    row, column = np.indices((rows, columns))
    places = ((n - _BORDER) * _GRID_PX for n in (column, row))
    origins, directions = camera.rays(*places)
    # Where a ray does not go down, it is the white beyond the floor's end.
    far = (camera.floor_m - camera.target_m[1] - origins[..., 1]) / np.minimum(
        directions[..., 1], -1e-6
    )
    points = (origins + far[..., None] * directions).reshape(-1, 3)
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), points.shape)
    turn = (row % _FLOOR_TILE * _FLOOR_TILE + column % _FLOOR_TILE).ravel()
    shade = np.zeros(len(points))
    count = _FLOOR_RAYS * _FLOOR_TILE**2
    for share, rays in ((_FLOOR_KEY, _lamp(count)), (1 - _FLOOR_KEY, _sphere(2 * count)[:count])):
        spread = rays.reshape(_FLOOR_RAYS, -1, 3).swapaxes(0, 1)
        falls, arrives = surface.reached(points, up, spread[turn])
        shade += share * (1 - arrives / falls)
    shade = gaussian_filter(shade.reshape(rows, columns), _FLOOR_BLUR, mode="nearest")
    for axis, size in enumerate(size_px):
        place = (np.arange(size) + 0.5) / _GRID_PX + _BORDER
        before, part = place.astype(int), np.expand_dims(place % 1, 1 - axis)
        shade = shade.take(before, axis) * (1 - part) + shade.take(before + 1, axis) * part
    return (_FLOOR * (1 - shade)).astype(np.float32)


def _lamp(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors to all parts of the lamp."""
    rays = _LAMP + _LAMP_RADIUS * _sphere(count)
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)


def _sphere(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors, evenly all around: each is turned by the golden ratio from the last."""
    number = np.arange(count)
    height, around = 1 - (2 * number + 1) / count, number * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - height**2)
    rays = np.stack([flat * np.cos(around), height, flat * np.sin(around)], axis=1)
    return rays.astype(np.float32)


def _outline(far: NDArray[np.float32], step: float) -> NDArray[np.bool_]:
    """Those of (H, W) pixels that a neighbour lies before or behind."""
    found = np.zeros(far.shape, bool)
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


_TONES = np.round(255 * linear_to_srgb(np.linspace(0, 1, 1 << 14))).astype(np.uint8)
