"""Render posed bodies on a white floor in soft light; equal arguments give equal pixels.

The scene is lit by an area light and by ambient light from all around. Both are computed by rays in
fixed directions, at the vertices and on a coarse grid of the floor, and interpolated between: there
is no noise, and nothing flickers from frame to frame. Bodies are found by one ray per pixel, and by
more along their outlines.
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
from dsnet.pictures.skins import Skin, linear_to_srgb, srgb_to_linear

CLAY_SRGB = (0.86, 0.79, 0.73)
_MARGIN = 0.04
_LAMP = np.array([-0.5, 1.0, 0.75]) / np.linalg.norm([-0.5, 1.0, 0.75])
"""Direction from the bodies to the centre of the lamp, a sphere."""
_LAMP_RADIUS = 0.65
# What a white surface reflects: of the lamp when it faces it, of the ambient light when its normal
# is horizontal, and how much more when it points up.
_KEY, _AMBIENT, _FROM_ABOVE = 0.6, 0.5, 0.08
# Rays from a vertex to the lamp and to the surroundings; number of different sets of rays, which
# vertices use in turn; how often the result is averaged over neighbouring faces.
_KEY_RAYS, _AMBIENT_RAYS, _RAY_SETS, _SMOOTHINGS = 6, 6, 6, 6
# An unshaded floor is brighter than 1, so that it clips to the white of the page.
_FLOOR, _FLOOR_KEY, _FLOOR_RAYS, _FLOOR_TILE, _FLOOR_BLUR = 1.08, 0.63, 6, 4, 1.8
_GRID_PX, _BORDER = 4, 4
"""Pixels between the grid points where the floor's light is computed; grid points around the
picture."""
_LIFT_M, _FACING_AWAY = 3e-3, -0.3
_OUTLINE_PX = 8.0
"""Neighbouring pixels whose depths differ by more than this many pixels lie on an outline."""
_NO_HIT_M = np.float32(-1e9)
_SUBPIXELS = (np.array([[0, 1, 2, 3, 4, 5, 6, 7], [0, 4, 2, 6, 1, 5, 3, 7]]) + 0.5) / 8
"""x and y of an outline's rays within a pixel: one in each eighth of its width and its height."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective camera; use the same one for panels that are to be compared."""

    target_m: NDArray[np.float64]
    """(3,) point at the centre of the picture; rays are relative to it."""
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
        """Origins and directions (..., 3) of rays through points of the picture."""
        across = (x_px - self.width_px / 2) * self.pixel
        along = (self.height_px / 2 - y_px) * self.pixel
        right, up, back = self.axes.astype(np.float32)
        directions = np.multiply.outer(across.astype(np.float32), right) + (
            np.multiply.outer(along.astype(np.float32), up) - back
        )
        return np.broadcast_to(self.away_m.astype(np.float32), directions.shape), directions

    @property
    def pixel_m(self) -> float:
        """Width of a pixel at the target, metres."""
        return self.pixel * float(np.linalg.norm(self.away_m))

    def bounding_pixels(self, points: NDArray) -> tuple[slice, slice]:
        """Rows and columns of the picture that contain points (N, 3)."""
        x, y, away = ((points - self.away_m) @ self.axes.T).T
        size_px = np.array([self.height_px, self.width_px])
        pixels = size_px[:, None] / 2 - np.stack([y, -x]) / -away / self.pixel
        first = np.clip(pixels.min(axis=1).astype(int) - 1, 0, size_px)
        last = np.clip(pixels.max(axis=1).astype(int) + 2, 0, size_px)
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
    # A long focal length, so that bodies at the ends of a row are not distorted.
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
    colours: Sequence[ArrayLike | Skin | None],
) -> NDArray[np.uint8]:
    """Render bodies on a floor in soft light; gives sRGB (height, width, 3).

    Each body has vertices (V, 3), metres, y up, and perhaps `colours`: of its vertices (V, 3), sRGB
    in [0, 1], or a skin; clay where None. Faces (F, 3) are counter-clockwise from outside.
    """
    # Relative to the target: far from the origin, float32 would be too coarse.
    placed = [np.asarray(body) - camera.target_m for body in bodies]
    skins = [colour if isinstance(colour, Skin) else None for colour in colours]
    surface = _Surface(placed, np.asarray(faces), skins, camera.pixel_m)
    painted = [_vertex_colours(colour, body) for body, colour in zip(bodies, colours, strict=True)]
    radiance = srgb_to_linear(np.concatenate(painted))
    radiance = (radiance * _light_on(surface, camera.axes[2])[:, None]).astype(np.float32)
    floor = np.repeat(_light_on_floor(surface, camera)[..., None], 3, axis=2)
    light, depth = floor.copy(), np.full(floor.shape[:2], _NO_HIT_M)
    region = camera.bounding_pixels(surface.vertices)
    y, x = np.mgrid[region]
    hit, depth[region], colour = surface.shade(*camera.rays(x + 0.5, y + 0.5), radiance)
    light[region][hit] = colour
    y, x = np.nonzero(_outline(depth, _OUTLINE_PX * camera.pixel_m))
    across, down = _SUBPIXELS
    hit, _, colour = surface.shade(*camera.rays(x[:, None] + across, y[:, None] + down), radiance)
    mixed = np.repeat(floor[y, x][:, None], len(across), axis=1)
    mixed[hit] = colour
    light[y, x] = np.minimum(mixed, 1).mean(axis=1)
    return _TONES[(np.clip(light, 0, 1) * np.float32(len(_TONES) - 1)).astype(np.int16)]


def _vertex_colours(colour: ArrayLike | Skin | None, body: ArrayLike) -> NDArray:
    """(V, 3) sRGB; white below a skin, whose colours are by texel."""
    if isinstance(colour, Skin):
        colour = (1.0, 1.0, 1.0)
    return np.broadcast_to(CLAY_SRGB if colour is None else colour, np.shape(body))


class _Surface:
    """All bodies of a picture as one mesh for ray casting, metres, y up."""

    def __init__(
        self,
        bodies: Sequence[NDArray],
        faces: NDArray,
        skins: Sequence[Skin | None],
        pixel_m: float,
    ) -> None:
        self._skins, self._face_count, self._pixel_m = skins, len(faces), pixel_m
        first = np.cumsum([0, *map(len, bodies[:-1])])
        self.vertices = np.concatenate(bodies).astype(np.float32)
        self.faces = np.concatenate([faces + start for start in first]).astype(np.int32)
        self._scene = _embree_scene(self.vertices, self.faces)

    def shade(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], radiance: NDArray
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray]:
        """Cast rays (..., 3): which hit a body, at what distance (...), the light of M hits (M, 3).

        `radiance` (V, 3) of the vertices is interpolated over faces. A ray without a hit has the
        distance `_NO_HIT_M`.
        """
        rays = (one.reshape(-1, 3) for one in (origins, directions))
        result = self._scene.run(*rays, query="INTERSECT", output=True)
        hit = result["primID"] >= 0
        corners = self.faces[result["primID"][hit]]
        u, v = result["u"][hit, None], result["v"][hit, None]
        light = radiance[corners[:, 0]] * (1 - u - v)
        light += radiance[corners[:, 1]] * u
        light += radiance[corners[:, 2]] * v
        body, face = np.divmod(result["primID"][hit], self._face_count)
        for number, skin in enumerate(self._skins):
            if skin is not None:
                of_body = body == number
                shares = np.hstack([1 - u - v, u, v])[of_body]
                light[of_body] *= skin.at(face[of_body], shares, self._pixel_m)
        shape = origins.shape[:-1]
        distance = np.where(hit, result["tfar"], _NO_HIT_M)
        return hit.reshape(shape), distance.reshape(shape), light

    def irradiance(self, points: NDArray, normals: NDArray, rays: NDArray) -> NDArray[np.float32]:
        """(2, N) light that arrives by rays (N, R, 3) at points with normals (N, 3): without and
        with shadows."""
        unshadowed = np.maximum(np.einsum("nx,nrx->nr", normals, rays), 0)
        point, ray = np.nonzero(unshadowed)
        start = (points + _LIFT_M * normals)[point].astype(np.float32)
        hidden = self._scene.run(start, rays[point, ray], query="OCCLUDED") >= 0
        shadowed = unshadowed.copy()
        shadowed[point[hidden], ray[hidden]] = 0
        return np.stack([unshadowed.sum(axis=1), shadowed.sum(axis=1)])


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
    """(V,) light that the vertices would reflect if they were white.

    It is zero where the normal points away from the direction `towards` (3,) of the camera.
    """
    normals = vertex_normals(surface.vertices, surface.faces).astype(np.float32)
    facing = np.flatnonzero(normals @ towards > _FACING_AWAY)
    lamp, ambient = _lamp(_RAY_SETS * _KEY_RAYS), _sphere(_RAY_SETS * _AMBIENT_RAYS)
    sums = np.zeros((len(normals), 4), np.float32)
    for column, rays in ((0, lamp), (2, ambient)):
        sets = np.stack([rays[first::_RAY_SETS] for first in range(_RAY_SETS)])
        light = surface.irradiance(
            surface.vertices[facing], normals[facing], sets[facing % _RAY_SETS]
        )
        sums[facing, column : column + 2] = light.T
    corners, starts = surface.faces.ravel(), np.arange(0, surface.faces.size + 1, 3)
    of_faces = sparse.csr_array((np.ones_like(corners, np.float32), corners, starts))
    for _ in range(_SMOOTHINGS):
        sums = of_faces.T @ (of_faces @ sums)
    # Only the visible fractions are smoothed; the shading by the normal stays sharp.
    lit, open_sky = (sums[:, 1::2] / np.maximum(sums[:, ::2], np.float32(1e-9))).T
    key = lit * np.maximum(normals @ lamp.T, 0).mean(axis=1)
    return _KEY * key + (_AMBIENT + _FROM_ABOVE * normals[:, 1]) * open_sky


def _light_on_floor(surface: _Surface, camera: Camera) -> NDArray[np.float32]:
    """(height, width) light that a white floor, which fills the picture, reflects."""
    size_px = np.array([camera.height_px, camera.width_px])
    rows, columns = -(-size_px // _GRID_PX) + 2 * _BORDER
    row, column = np.indices((rows, columns))
    origins, directions = camera.rays(*((n - _BORDER) * _GRID_PX for n in (column, row)))
    # A ray that does not point down meets the floor far away, where it is white.
    far = (camera.floor_m - camera.target_m[1] - origins[..., 1]) / np.minimum(
        directions[..., 1], -1e-6
    )
    points = (origins + far[..., None] * directions).reshape(-1, 3)
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), points.shape)
    ray_set = (row % _FLOOR_TILE * _FLOOR_TILE + column % _FLOOR_TILE).ravel()
    shade = np.zeros(len(points))
    count = _FLOOR_RAYS * _FLOOR_TILE**2
    for share, rays in ((_FLOOR_KEY, _lamp(count)), (1 - _FLOOR_KEY, _sphere(2 * count)[:count])):
        sets = rays.reshape(_FLOOR_RAYS, -1, 3).swapaxes(0, 1)
        unshadowed, shadowed = surface.irradiance(points, up, sets[ray_set])
        shade += share * (1 - shadowed / unshadowed)
    shade = gaussian_filter(shade.reshape(rows, columns), _FLOOR_BLUR, mode="nearest")
    for axis, size in enumerate(size_px):
        position = (np.arange(size) + 0.5) / _GRID_PX + _BORDER
        before, part = position.astype(int), np.expand_dims(position % 1, 1 - axis)
        shade = shade.take(before, axis) * (1 - part) + shade.take(before + 1, axis) * part
    return (_FLOOR * (1 - shade)).astype(np.float32)


def _lamp(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors to points all over the lamp."""
    rays = _LAMP + _LAMP_RADIUS * _sphere(count)
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)


def _sphere(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors, evenly spaced over the sphere (a Fibonacci lattice)."""
    number = np.arange(count)
    height, azimuth = 1 - (2 * number + 1) / count, number * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - height**2)
    rays = np.stack([flat * np.cos(azimuth), height, flat * np.sin(azimuth)], axis=1)
    return rays.astype(np.float32)


def _outline(far: NDArray[np.float32], step: float) -> NDArray[np.bool_]:
    """Which of (H, W) pixels differ in depth from a neighbour by more than a step."""
    outline = np.zeros(far.shape, bool)
    for one, other in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        apart = np.abs(far[one] - far[other]) > step
        outline[one] |= apart
        outline[other] |= apart
    return outline


_TONES = np.round(255 * linear_to_srgb(np.linspace(0, 1, 1 << 14))).astype(np.uint8)
