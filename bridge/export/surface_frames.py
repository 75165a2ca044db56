"""A moving body one frame at a time, with the normals of its skin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import sparse

from bridge.runtime.moving_body import MovingBody


class VertexNormals:
    """Unit normals of a surface's vertices: the mean of the faces about each, by their areas.

    Parameters
    ----------
    faces : (F, 3) vertex indices, counter-clockwise from outside.
    vertex_count : V.
    """

    def __init__(self, faces: NDArray, vertex_count: int) -> None:
        self._faces = faces
        found = trimesh.geometry.index_sparse(vertex_count, faces, dtype=np.float32)
        self._faces_of_vertex = sparse.csr_array(found)  # (V, F)

    def __call__(self, vertices: NDArray) -> NDArray[np.float32]:
        """(V, 3) of vertices (V, 3); zero where a vertex has no area about it."""
        corners = vertices[self._faces]
        area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = self._faces_of_vertex @ area_vectors
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return (normals / np.where(length > 0, length, 1)).astype(np.float32)


def meshes(moving: MovingBody) -> Iterator[tuple[int, trimesh.Trimesh]]:
    """Number and mesh of each frame; `offset_m` of a vertex is the length of its skin offset."""
    body = moving.body
    normals = VertexNormals(body.faces, body.vertex_count)
    for posed in moving:
        numbers = range(posed.frames.start, posed.frames.stop)
        for number, offsets_m, vertices_m in zip(
            numbers, posed.offsets_m, posed.vertices_m, strict=True
        ):
            size_m = np.linalg.norm(offsets_m, axis=1)
            yield (
                number,
                trimesh.Trimesh(
                    vertices_m,
                    body.faces,
                    vertex_normals=normals(vertices_m),
                    vertex_attributes={"offset_m": size_m},
                    process=False,
                ),
            )
