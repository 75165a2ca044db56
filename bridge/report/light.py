"""How much light falls on bodies and on the floor below them: a broad lamp and a bright sky.

Rays in fixed directions say what is hidden from them, at each vertex and at the points of a coarse
grid of the floor, so that there is no grain, and nothing flickers from picture to picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import gaussian_filter

from bridge.body.surface_operators import vertex_normals
from bridge.errors import DsnetError

# From the bodies to the lamp.
_KEY_DIRECTION = np.array([-0.5, 1.0, 0.75]) / np.linalg.norm([-0.5, 1.0, 0.75])
_KEY_WIDTH_RAD = 0.3
# Light that a white surface sends back: of the lamp if it faces it, of the surroundings if it
# looks to the side, and how much more if it looks up.
_KEY, _AROUND, _ABOVE = 0.6, 0.5, 0.08
# Rays of one vertex; so many neighbours have different ones; how often their means are taken.
_KEY_RAYS, _AROUND_RAYS, _TURNS, _SMOOTHED = 5, 4, 6, 4
# An unshaded floor is a shade brighter than the paper around the picture: both clip to white.
_FLOOR, _FLOOR_KEY = 1.08, 0.63
_FLOOR_RAYS, _TILE, _FLOOR_BLUR = 12, 4, (1.8, 1.5)
_LIFT_M, _AWAY = 1e-3, -0.3
GRID_STEP_PX, GRID_BORDER = np.array([2, 4]), 4
"""Rows and columns of a picture between points where the floor's light is found; more of them
around the picture."""


class RayScene:
    """All bodies of a picture, vertices (V, 3) of each, metres, y up, to be hit by rays."""

    def __init__(self, bodies: Sequence[NDArray], faces: NDArray) -> None:
        first = np.cumsum([0, *map(len, bodies[:-1])])
        self.vertices = np.concatenate(bodies).astype(np.float32)
        self.faces = np.concatenate([faces + start for start in first]).astype(np.int32)
        self._bounds = np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])
        self._scene = _scene(self.vertices, self.faces)

    def seen(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], sent: NDArray
    ) -> tuple[NDArray[np.float32], NDArray]:
        """How far rays (..., 3) come, infinite if they miss; what arrives by the others (M, 3).

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
        far = np.where(hit, met["tfar"], np.float32(np.inf))
        return far.reshape(origins.shape[:-1]), arrives

    def hidden(self, points: NDArray, directions: NDArray) -> NDArray[np.bool_]:
        """Whether rays (N, 3) meet a body."""
        rays = (np.ascontiguousarray(one, np.float32) for one in (points, directions))
        return self._scene.run(*rays, query="OCCLUDED") >= 0

    def near(self, points: NDArray, directions: NDArray) -> NDArray[np.bool_]:
        """(N, H, W) whether rays in N directions from the floor (H, W, 3) may meet a body."""
        heights = [np.zeros(1), self._bounds[1, 1:2] - points[0, 0, 1]]
        for axis in (0, 2):
            slope = directions[:, axis] / directions[:, 1]
            slope = np.where(np.abs(slope) < 1e-6, np.float32(1e-6), slope)[:, None, None]
            ends = [(bound - points[..., axis]) / slope for bound in self._bounds[:, axis]]
            heights[0] = np.maximum(heights[0], np.minimum(*ends))
            heights[1] = np.minimum(heights[1], np.maximum(*ends))
        return heights[0] < heights[1]


def _scene(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> Any:
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


def light_on_bodies(surface: RayScene, towards: NDArray) -> NDArray[np.float32]:
    """(V,) light that the vertices would send back if they were white.

    Neighbours send rays in different directions, and their mean is taken. Those that look away from
    the direction `towards` (3,) send none, as no picture shows them.
    """
    normals = vertex_normals(surface.vertices, surface.faces).astype(np.float32)
    lamp, around = _lamp(_TURNS * _KEY_RAYS), _sphere(_TURNS * _AROUND_RAYS)
    looking = np.flatnonzero(normals @ towards > _AWAY)
    # Of the lamp and of all around: what falls on the vertices, and what arrives there of it.
    sums = np.zeros((len(normals), 4), np.float32)
    for turn in range(_TURNS):
        here = looking[looking % _TURNS == turn]
        directions = np.concatenate([lamp[turn::_TURNS], around[turn::_TURNS]])
        falls = np.maximum(normals[here] @ directions.T, 0)
        vertex, ray = np.nonzero(falls)
        start = surface.vertices[here] + _LIFT_M * normals[here]
        hidden = surface.hidden(start[vertex], directions[ray])
        arrives = falls.copy()
        arrives[vertex[hidden], ray[hidden]] = 0
        both = np.concatenate([falls, arrives], axis=1)
        ends = [0, _KEY_RAYS, falls.shape[1], falls.shape[1] + _KEY_RAYS]
        sums[here] = np.add.reduceat(both, ends, axis=1)
    corners, starts = surface.faces.ravel(), np.arange(0, surface.faces.size + 1, 3)
    of_faces = sparse.csr_array((np.ones_like(corners, np.float32), corners, starts))
    for _ in range(_SMOOTHED):
        sums = of_faces.T @ (of_faces @ sums)
    # The share that arrives is smooth over the surface; what falls on it follows its shape.
    key, open_to = (sums[:, 2:] / np.maximum(sums[:, :2], np.float32(1e-9))).T
    key *= np.maximum(normals @ lamp.T, 0).mean(axis=1)
    light = _KEY * key + (_AROUND + _ABOVE * normals[:, 1]) * open_to
    return light.astype(np.float32)


def light_on_floor(surface: RayScene, points: NDArray) -> NDArray[np.float32]:
    """(H, W) light that a white floor sends back at points (H, W, 3) of a grid.

    Neighbours send rays in different directions, and their mean is taken.
    """
    rays, hidden = _from_floor(), np.zeros((_FLOOR_RAYS, *points.shape[:2]), np.float32)
    for turn, (row, column) in enumerate(product(range(_TILE), repeat=2)):
        here = points[row::_TILE, column::_TILE]
        ray, *at = np.nonzero(surface.near(here, rays[turn]))
        start = here[tuple(at)] + [0, _LIFT_M, 0]
        hidden[:, row::_TILE, column::_TILE][(ray, *at)] = surface.hidden(start, rays[turn, ray])
    shade = gaussian_filter(hidden.mean(axis=0), _FLOOR_BLUR, mode="nearest")
    return (_FLOOR * (1 - shade)).astype(np.float32)


def _from_floor() -> NDArray[np.float32]:
    """(16, 12, 3) directions to the lamp and the sky, as many to each as light comes from there."""
    lamp_rays = round(_FLOOR_KEY * _FLOOR_RAYS)
    turns = _TILE * _TILE
    lamp = _lamp(lamp_rays * turns).reshape(lamp_rays, turns, 3)
    spread = _sky((_FLOOR_RAYS - lamp_rays) * turns).reshape(-1, turns, 3)
    return np.concatenate([lamp, spread]).swapaxes(0, 1)


def _lamp(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors to a lamp whose light fades from its middle as a Gaussian does."""
    part, around = _spiral(count)
    away = _KEY_WIDTH_RAD * np.sqrt(-2 * np.log(1 - 0.95 * part))
    aside = np.cross(_KEY_DIRECTION, [0.0, 1.0, 0.0])
    aside /= np.linalg.norm(aside)
    axes = np.stack([aside, np.cross(_KEY_DIRECTION, aside), _KEY_DIRECTION])
    return (_polar(np.cos(away), around) @ axes).astype(np.float32)


def _sky(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors upwards, as many as the floor sees of the sky."""
    part, around = _spiral(count)
    return _polar(np.sqrt(1 - part), around)[:, [0, 2, 1]].astype(np.float32)


def _sphere(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors, evenly all around."""
    part, around = _spiral(count)
    return _polar(1 - 2 * part, around).astype(np.float32)


def _spiral(count: int) -> tuple[NDArray, NDArray]:
    """Evenly spread: parts of a whole, and angles that turn by the golden ratio."""
    number = np.arange(count)
    return (number + 0.5) / count, number * np.pi * (3 - np.sqrt(5))


def _polar(cosine: NDArray, around: NDArray) -> NDArray:
    """(N, 3) unit vectors about the third axis."""
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(around), sine * np.sin(around), cosine], axis=1)
