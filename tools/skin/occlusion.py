"""How much of the surroundings each vertex sees, from its own body at rest."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from scipy import sparse

from bridge.body import BodyModelData
from bridge.body.surface_operators import vertex_normals

RAYS = 256
FAR_M = 0.35
"""Skin that is farther away shades nothing."""
_LIFT_M = 1e-3
_SMOOTHINGS, _PIECES = 3, 40


def open_share(body: BodyModelData) -> NDArray:
    """(V,) 1 where nothing is near, 0 where all around is skin."""
    vertices, faces = body.v_template.astype(np.float32), body.faces.astype(np.int32)
    normals = vertex_normals(vertices, faces).astype(np.float32)
    scene = EmbreeScene()
    TriangleMesh(scene, vertices, faces)
    sphere = _sphere(RAYS)
    shaded = np.zeros(len(vertices))
    for rows in np.array_split(np.arange(len(vertices)), _PIECES):
        rays = sphere + normals[rows, None]  # as many per solid angle as light by the cosine
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        start = np.broadcast_to((vertices + _LIFT_M * normals)[rows, None], rays.shape)
        both = (np.ascontiguousarray(one, np.float32).reshape(-1, 3) for one in (start, rays))
        hit = scene.run(*both, query="INTERSECT", output=True)
        near = np.where(hit["primID"] >= 0, np.clip(1 - hit["tfar"] / FAR_M, 0, 1), 0)
        shaded[rows] = near.reshape(len(rows), -1).mean(axis=1)
    corners = faces.ravel()
    of_faces = sparse.csr_array((np.ones(len(corners)), corners, np.arange(0, len(corners) + 1, 3)))
    count = of_faces.T @ np.full(len(faces), 3.0)
    for _ in range(_SMOOTHINGS):
        shaded = of_faces.T @ (of_faces @ shaded) / count
    return 1 - shaded


def _sphere(count: int) -> NDArray[np.float32]:
    """(N, 3) unit vectors, evenly spaced (a Fibonacci lattice)."""
    number = np.arange(count)
    height, azimuth = 1 - (2 * number + 1) / count, number * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(azimuth), height, flat * np.sin(azimuth)], 1).astype(np.float32)
