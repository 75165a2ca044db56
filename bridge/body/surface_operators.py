"""Geometry of a triangle mesh: volume, vertex areas and normals, and the cotangent Laplacian."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray


def volume_m3(vertices: NDArray, faces: NDArray[np.integer]) -> float:
    """Volume within a closed surface, wound counter-clockwise seen from outside."""
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.einsum("fx,fx->", first, np.cross(second, third)) / 6)


def vertex_areas_m2(vertices: ArrayLike, faces: NDArray[np.integer]) -> NDArray[np.floating]:
    """(V,) a third of the area of the triangles around each vertex."""
    corners = np.asarray(vertices)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.zeros(len(np.asarray(vertices)))
    np.add.at(areas, faces, np.linalg.norm(normals, axis=1)[:, None] / 6)
    return areas


def vertex_normals(vertices: ArrayLike, faces: NDArray[np.integer]) -> NDArray[np.floating]:
    """(V, 3) outward normals: the mean of the triangles around, weighted by area; 0 where none."""
    corners = np.asarray(vertices)[faces]
    of_faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = [
        np.bincount(faces.ravel(), np.repeat(component, 3), len(np.asarray(vertices)))
        for component in of_faces.T
    ]
    normals = np.stack(sums, axis=1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0, lengths, 1.0)


def cotangent_laplacian(vertices: ArrayLike, faces: NDArray[np.integer]) -> sp.csr_matrix:
    """(V, V) positive semi-definite: u^T L u is the Dirichlet energy of u over the surface."""
    vertices = np.asarray(vertices)
    rows, columns, values = [], [], []
    for corner in range(3):
        apex, left, right = (faces[:, (corner + shift) % 3] for shift in range(3))
        to_left, to_right = vertices[left] - vertices[apex], vertices[right] - vertices[apex]
        area = np.linalg.norm(np.cross(to_left, to_right), axis=1)
        rows.append(left)
        columns.append(right)
        values.append((to_left * to_right).sum(1) / np.maximum(area, 1e-12) / 2)
    count = len(vertices)
    indices = (np.concatenate(rows), np.concatenate(columns))
    weights = sp.coo_matrix((np.concatenate(values), indices), shape=(count, count))
    weights = weights + weights.T
    return sp.csr_matrix(sp.diags(np.asarray(weights.sum(1)).ravel()) - weights)
