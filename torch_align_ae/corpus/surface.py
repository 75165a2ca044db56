"""Normals of a triangle mesh, and what diffuses over it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2

Array = NDArray[np.floating]


def vertex_normals(vertices: Array, faces: NDArray[np.integer]) -> Array:
    """(V, 3) outward normals: the mean of the triangles around, weighted by area."""
    corners = vertices[faces]
    of_faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = [
        np.bincount(faces.ravel(), np.repeat(component, 3), len(vertices))
        for component in of_faces.T
    ]
    normals = np.stack(sums, axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def smooth_over_surface(
    values: Array, vertices: Array, faces: NDArray[np.integer], length_m: float
) -> Array:
    """Diffuse `values` (V,) or (V, n) along the surface over about `length_m`."""
    mass = sp.diags(vertex_areas_m2(vertices, faces))
    system = mass + length_m**2 * cotangent_laplacian(vertices, faces)
    return splu(system.tocsc()).solve(mass @ values)
