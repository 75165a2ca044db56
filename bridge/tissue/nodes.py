"""Nodes on the skin that carry its soft tissue, and the smooth surface between them.

Tissue moves smoothly: 500 of SMPL's 6890 vertices as nodes, and the surface of least bending
between them, keep all but a hundredth of the simulated offsets' energy under either tissue law
(tested). A node costs what a vertex costs, and noise of single vertices is averaged away at nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body import BodyModelData
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2

_NODES_PER_VERTEX = 8
"""Nodes that share a vertex; the others' weights are negligible."""
_NEIGHBOURS_PER_VERTEX = 6
_REGULAR = 1e-9
_BLOCK = 106
"""Consecutive vertices that are interpolated by one matrix product from the nodes near them; these
are few, as vertex numbers follow the surface. 65 blocks are SMPL's 6890 vertices."""
_COLUMNS_AT_ONCE = 4
"""Of a factored system's right sides. With more, SuperLU calls BLAS's threads for each of its many
small blocks, which costs far more than they save."""


@dataclass(frozen=True, eq=False)
class TissueNodes:
    """K nodes among the V vertices of a body model."""

    vertices: NDArray[np.int32]
    """(K,) the vertices at which nodes sit."""
    owners: NDArray[np.int32]
    """(V, 8) nodes that share each vertex."""
    shares: NDArray[np.float32]
    """(V, 8) their weights, which sum to 1; some are negative, as a smooth surface needs."""
    areas_m2: NDArray[np.float32]
    """(V,) skin area of each vertex on the template."""
    edges: NDArray[np.int32]
    """(E, 2) pairs of nodes that pull at each other, each with itself too."""
    pulls_m2: NDArray[np.float32]
    """(E,) entries of the surface's Laplacian between nodes, per unit of mass, 1/m^2."""

    @classmethod
    def of(cls, body: BodyModelData, count: int) -> TissueNodes:
        """Spread `count` nodes evenly over the template, farthest point first."""
        template = np.asarray(body.v_template, np.float64)
        return cls.at(body, farthest_points(template, count), np.arange(len(template)))

    @classmethod
    def at(cls, body: BodyModelData, nodes: NDArray, skin: NDArray) -> TissueNodes:
        """Nodes at vertices (K,) among those that have flesh, `skin`; the others keep still."""
        template, faces = np.asarray(body.v_template, np.float64)[skin], body.faces
        if len(skin) < body.vertex_count:
            number = np.full(body.vertex_count, -1)
            number[skin] = np.arange(len(skin))
            faces = number[faces][(number[faces] >= 0).all(axis=1)]
            nodes = number[nodes]
        areas_m2, laplacian = vertex_areas_m2(template, faces), cotangent_laplacian(template, faces)
        bending = laplacian @ sp.diags(1 / areas_m2) @ laplacian
        owners, shares = _largest(_between(bending, nodes), _NODES_PER_VERTEX)
        stretched = _largest(_between(laplacian, nodes), _NEIGHBOURS_PER_VERTEX)
        edges, pulls_m2 = _node_laplacian(
            shares_matrix(*stretched, len(nodes)), laplacian, areas_m2
        )
        owners, shares, areas_m2 = (
            _among(body.vertex_count, skin, of_skin)
            for of_skin in (owners, shares, areas_m2.astype(np.float32))
        )
        return cls(skin[nodes].astype(np.int32), owners, shares, areas_m2, edges, pulls_m2)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray]) -> TissueNodes:
        """The inverse of `arrays`."""
        return cls(**{name: arrays[f"nodes/{name}"] for name in cls.__dataclass_fields__})

    def arrays(self) -> dict[str, NDArray]:
        """All fields, `nodes/<field>`."""
        return {f"nodes/{name}": getattr(self, name) for name in self.__dataclass_fields__}

    def __len__(self) -> int:
        return len(self.vertices)

    @cached_property
    def laplacian(self) -> sp.csr_matrix:
        """(K, K) 1/m^2: rows sum to zero."""
        size = (len(self), len(self))
        return sp.csr_matrix((self.pulls_m2, tuple(self.edges.T)), shape=size)

    @cached_property
    def _spread(self) -> sp.csr_matrix:
        return shares_matrix(self.owners, self.shares, len(self))

    @cached_property
    def _weighted(self) -> sp.csr_matrix:
        """(K, V) transpose of `_spread`, weighted by skin area."""
        return sp.csr_matrix((sp.diags(self.areas_m2 / self.areas_m2.mean()) @ self._spread).T)

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        """(K, K) of the normal equations, which are well conditioned."""
        gram = sp.csr_matrix(self._weighted @ self._spread)
        return np.linalg.inv(gram.toarray().astype(np.float64))

    def spread(self, at_nodes: NDArray) -> NDArray[np.float32]:
        """Offsets (T, K, 3) of the nodes to those of all vertices (T, V, 3)."""
        return per_frame(self._spread, np.asarray(at_nodes, np.float32))

    def blocks(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """`spread` as products of small dense matrices: nodes (blocks, N) of blocks of consecutive
        vertices, and their shares (blocks, N, 106); of vertices after the last one, zeros."""
        starts = range(0, len(self.owners), _BLOCK)
        near = [np.unique(self.owners[start : start + _BLOCK]) for start in starts]
        most = max(map(len, near))
        nodes = np.zeros((len(near), most), np.int64)
        shares = np.zeros((len(near), most, _BLOCK), np.float32)
        for block, (start, of_block) in enumerate(zip(starts, near, strict=True)):
            vertices = np.arange(start, min(start + _BLOCK, len(self.owners)))
            nodes[block, : len(of_block)] = of_block
            rows = np.searchsorted(of_block, self.owners[vertices])  # (106, 8)
            shares[block, rows, (vertices - start)[:, None]] = self.shares[vertices]
        return nodes, shares

    def reading(self, vertices: NDArray) -> NDArray[np.float64]:
        """(N, K) how much of each node's offset some vertices (N,) take."""
        return self._spread[vertices].toarray().astype(np.float64)

    def gather(self, offsets_m: NDArray) -> NDArray[np.float32]:
        """(T, K, 3) whose spread comes closest to offsets (T, V, 3): least squares over area."""
        right = per_frame(self._weighted, np.asarray(offsets_m, np.float32))
        count = len(right)
        flat = right.transpose(1, 0, 2).reshape(len(self), -1).astype(np.float64)
        solved = (self._inverse @ flat).reshape(len(self), count, 3)
        return solved.transpose(1, 0, 2).astype(np.float32)


def _among(count: int, rows: NDArray, values: NDArray) -> NDArray:
    """(count, ...) the values of some rows, zeros in all others."""
    whole = np.zeros((count, *values.shape[1:]), values.dtype)
    whole[rows] = values
    return whole


def per_frame(matrix: sp.csr_matrix, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Apply (M, N) to every frame of (T, N, 3)."""
    count, rows, axes = values.shape
    flat = np.ascontiguousarray(values.transpose(1, 0, 2)).reshape(rows, count * axes)
    return np.ascontiguousarray((matrix @ flat).reshape(-1, count, axes).transpose(1, 0, 2))


def farthest_points(points: NDArray, count: int) -> NDArray[np.int64]:
    """(count,) which of (P, 3): spread evenly, each the farthest from those before it."""
    chosen, distance = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.sort(np.array(chosen))


def _between(energy: sp.csr_matrix, nodes: NDArray) -> NDArray[np.floating]:
    """(V, K) each node's share of every vertex: the least `energy` with 1 at it, 0 at others."""
    energy = sp.csr_matrix(energy)
    count = len(energy.indptr) - 1
    free = np.setdiff1d(np.arange(count), nodes)
    shares = np.zeros((count, len(nodes)))
    shares[nodes, np.arange(len(nodes))] = 1.0
    rows = energy[free]
    inner = (rows[:, free] + _REGULAR * sp.eye(len(free))).tocsc()
    solver = splu(inner, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    pulled = -rows[:, nodes].tocsc()
    for start in range(0, len(nodes), _COLUMNS_AT_ONCE):
        columns = slice(start, start + _COLUMNS_AT_ONCE)
        shares[free, columns] = solver.solve(pulled[:, columns].toarray())
    return shares


def _largest(shares: NDArray, count: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """The `count` largest shares of each vertex, scaled to sum to 1: (V, count) twice."""
    owners = np.sort(np.argpartition(-np.abs(shares), count - 1, axis=1)[:, :count], axis=1)
    kept = np.take_along_axis(shares, owners, axis=1)
    return owners.astype(np.int32), (kept / kept.sum(1, keepdims=True)).astype(np.float32)


def shares_matrix(owners: NDArray, shares: NDArray, count: int) -> sp.csr_matrix:
    """(V, count) of the shares (V, 8) that owners (V, 8) have of vertices."""
    rows = np.repeat(np.arange(len(owners)), owners.shape[1])
    return sp.csr_matrix((shares.ravel(), (rows, owners.ravel())), shape=(len(owners), count))


def _node_laplacian(
    shares: sp.csr_matrix, laplacian: sp.csr_matrix, areas_m2: NDArray
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Galerkin's Laplacian of the nodes over their lumped masses, as pairs and values."""
    masses = np.asarray(shares.T @ areas_m2).ravel()
    between = sp.coo_matrix(sp.diags(1 / masses) @ (shares.T @ (laplacian @ shares)))
    edges = np.stack([between.row, between.col], axis=1).astype(np.int32)
    return edges, between.data.astype(np.float32)
