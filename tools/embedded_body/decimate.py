"""Reduce a closed mesh to an exact number of vertices by half-edge collapses.

Vertices only disappear and never move, so each one that is left is still a vertex of
MakeHuman's base mesh, and every shape and weight carries over by indexing. Plain quadric
decimation (Garland and Heckbert 1997) would spend a third of the vertices on the head and leave
the legs with edges of 16 cm; `priority` says where vertices are dear. One half is reduced and
mirrored; the midline keeps all its vertices.
"""

from __future__ import annotations

import heapq

import numpy as np

# Below this cosine a collapse would fold a face over.
_MIN_NORMAL_COSINE = 0.2


def decimate(
    vertices: np.ndarray,
    faces: np.ndarray,
    mirror: np.ndarray,
    priority: np.ndarray,
    foldable: np.ndarray,
    vertex_count: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Collapse the cheapest half-edges until `vertex_count` vertices are left.

    Parameters
    ----------
    vertices, faces : the closed symmetric mesh, (V, 3) and (F, 3).
    mirror : (V,) the vertex on the other side of each.
    priority : (V,) factor on the cost of removing each vertex.
    foldable : (V,) bool, vertices whose removal may fold faces, because nobody sees them.
    vertex_count : how many vertices to leave.

    Returns
    -------
    (vertex_count,) indices of the vertices left, ascending, and faces (F', 3) that index them.
    """
    midline = mirror == np.arange(len(mirror))
    half_count, odd = divmod(vertex_count + int(midline.sum()), 2)
    if odd:
        raise ValueError(f"{vertex_count} vertices, of which {midline.sum()} on the midline")
    half = faces[vertices[faces, 0].sum(axis=1) > 0]
    mesh = _CollapsingMesh(vertices, half, midline, priority, foldable)
    mesh.collapse_to(half_count)
    half = mesh.faces()
    both = np.concatenate([half, mirror[half][:, ::-1]])
    left = np.unique(both)
    return left, np.searchsorted(left, both)


class _CollapsingMesh:
    """Half a mesh, whose border stays as it is."""

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        border: np.ndarray,
        priority: np.ndarray,
        foldable: np.ndarray,
    ) -> None:
        self._vertices, self._priority, self._foldable = vertices, priority, foldable
        self._border = set(np.flatnonzero(border).tolist())
        self._faces: dict[int, tuple[int, ...]] = {}
        self._faces_of: list[set[int]] = [set() for _ in vertices]
        self._neighbours: list[set[int]] = [set() for _ in vertices]
        for index, face in enumerate(map(tuple, faces.tolist())):
            self._faces[index] = face
            for vertex in face:
                self._faces_of[vertex].add(index)
                self._neighbours[vertex] |= set(face) - {vertex}
        self._quadrics = _vertex_quadrics(vertices, faces)
        self._version = np.zeros(len(vertices), dtype=int)
        self._alive = np.array([bool(ring) for ring in self._neighbours])

    def collapse_to(self, vertex_count: int) -> None:
        """Collapse by a lazily updated heap: an entry is stale when a version has moved on."""
        heap = [self._entry(a, b) for a in range(len(self._alive)) for b in self._neighbours[a]]
        heapq.heapify(heap)
        left = int(self._alive.sum())
        while left > vertex_count:
            if not heap:
                raise RuntimeError(f"stuck at {left} vertices; expected {vertex_count}")
            _, removed, kept, version = heapq.heappop(heap)
            if self._is_stale(removed, kept, version) or not self._is_legal(removed, kept):
                continue
            self._collapse(removed, kept)
            left -= 1
            for neighbour in self._neighbours[kept]:
                heapq.heappush(heap, self._entry(kept, neighbour))
                heapq.heappush(heap, self._entry(neighbour, kept))

    def faces(self) -> np.ndarray:
        """(F', 3) what is left, by the vertices' old numbers."""
        return np.array([self._faces[index] for index in sorted(self._faces)])

    def _entry(self, removed: int, kept: int) -> tuple[float, int, int, int]:
        position = self._vertices[kept]
        homogeneous = np.append(position, 1.0)
        quadric = self._quadrics[removed] + self._quadrics[kept]
        length_squared = ((self._vertices[removed] - position) ** 2).sum()
        # The edge's length keeps triangles even where the surface is flat and any collapse is free.
        cost = homogeneous @ quadric @ homogeneous + 1e-2 * length_squared**2
        version = int(self._version[removed] + self._version[kept])
        return float(cost * self._priority[removed]), removed, kept, version

    def _is_stale(self, removed: int, kept: int, version: int) -> bool:
        return (
            not self._alive[removed]
            or not self._alive[kept]
            or kept not in self._neighbours[removed]
            or version != self._version[removed] + self._version[kept]
        )

    def _is_legal(self, removed: int, kept: int) -> bool:
        """Mesh and mirror image stay a manifold (link condition), no visible face turns over."""
        ring, kept_ring = self._neighbours[removed], self._neighbours[kept]
        if removed in self._border:
            return False
        if len(ring & kept_ring) != 2 or len(ring) + len(kept_ring) < 7:
            return False
        # A new edge between two vertices of the border would be the mirror image's as well.
        if kept in self._border and ring & self._border - kept_ring - {kept}:
            return False
        for face in self._faces_of[removed]:
            corners = self._faces[face]
            if kept in corners:
                continue
            before = _normal(self._vertices[list(corners)])
            moved = [kept if corner == removed else corner for corner in corners]
            after = _normal(self._vertices[moved])
            lengths = np.linalg.norm(before) * np.linalg.norm(after)
            if np.linalg.norm(after) < 1e-10:
                return False
            if not self._foldable[removed] and before @ after < _MIN_NORMAL_COSINE * lengths:
                return False
        return True

    def _collapse(self, removed: int, kept: int) -> None:
        for index in list(self._faces_of[removed]):
            corners = self._faces[index]
            if kept in corners:
                del self._faces[index]
                for corner in corners:
                    self._faces_of[corner].discard(index)
            else:
                moved = tuple(kept if corner == removed else corner for corner in corners)
                self._faces[index] = moved
                self._faces_of[kept].add(index)
        for neighbour in self._neighbours[removed]:
            self._neighbours[neighbour].discard(removed)
            if neighbour != kept:
                self._neighbours[neighbour].add(kept)
                self._neighbours[kept].add(neighbour)
        self._faces_of[removed], self._neighbours[removed] = set(), set()
        self._alive[removed] = False
        self._quadrics[kept] += self._quadrics[removed]
        self._version[kept] += 1


def _vertex_quadrics(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 4, 4) area-weighted squared distances to the planes around each vertex."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= double_area
    planes = np.c_[normals, -(normals * corners[:, 0]).sum(axis=1)]
    face_quadrics = planes[:, :, None] * planes[:, None, :] * double_area[:, :, None]
    quadrics = np.zeros((len(vertices), 4, 4))
    for corner in range(3):
        np.add.at(quadrics, faces[:, corner], face_quadrics)
    return quadrics


def _normal(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[1] - corners[0], corners[2] - corners[0])
