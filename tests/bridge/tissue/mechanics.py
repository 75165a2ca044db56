"""Mechanics of nodes for tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from bridge.tissue.oscillators import STEPS, coupling
from dsnet.onnx.onnx_graph import Graph, GraphSession, Value
from dsnet.onnx.tissue_graph import Springs, TissueConstants, TissueGraph
from dsnet.verify.reference.oscillators import Coefficients, Oscillators

ALONE = sp.csr_matrix((1, 1), dtype=np.float32)
"""Laplacian of a node without neighbours."""


def mechanics(
    count: int = 1,
    hz: ArrayLike = 5.0,
    damping: ArrayLike = 0.15,
    stiffening: ArrayLike = 0.0,
    sag: ArrayLike = 0.0,
    wave_speed: ArrayLike = 0.0,
    bending: ArrayLike = 0.0,
    normal_ratio: ArrayLike = 1.0,
    normals: ArrayLike = (0.0, 0.0, 1.0),
) -> Coefficients:
    """Nodes with gains of 1, alike where a number is given."""

    def each(values: ArrayLike) -> NDArray[np.float32]:
        return np.broadcast_to(np.asarray(values, np.float32), count).reshape(count, 1).copy()

    return Coefficients(
        omega=each(2 * np.pi * np.asarray(hz)),
        damping_ratio=each(damping),
        stiffening=each(stiffening),
        sag=each(sag),
        normal_ratio=each(normal_ratio),
        wave_speed=each(wave_speed),
        bending=each(bending),
        inertia_gain=each(1.0),
        gravity_gain=each(1.0),
        normals=np.broadcast_to(np.asarray(normals, np.float32), (count, 3)),
    )


class GraphSheet:
    """The product's step and equilibrium, by ONNX Runtime, with the interface of `Oscillators`."""

    def __init__(self, springs: Coefficients, laplacian: sp.csr_matrix) -> None:
        fields = vars(springs)
        coupled, rows = coupling(fields, laplacian), len(springs.normals)

        def session(
            make: Callable[[TissueGraph, Springs, dict[str, Value]], Value],
        ) -> GraphSession:
            graph = Graph()
            given = {n: graph.input(n, ("B", 3, rows)) for n in ("now", "before", "load")}
            own = {
                n: graph.array(n, fields[n].T[None]) for n in TissueConstants.__dataclass_fields__
            }
            sheet = TissueGraph(graph, fields, coupled, [1.0])
            found = {"found": make(sheet, sheet.springs(TissueConstants(**own)), given)}
            return GraphSession(graph.model("sheet", found, {}, checked=False), threads=1)

        self._step = session(lambda sheet, own, given: sheet.step(own, **given))
        self._settled = session(lambda sheet, own, given: sheet.settled(own, given["load"]))

    def step(self, now: NDArray, before: NDArray, load: NDArray) -> NDArray[np.float32]:
        return self._step(now=_row(now), before=_row(before), load=_row(load))["found"][0].T

    def frame(self, now: NDArray, before: NDArray, load: NDArray) -> tuple[NDArray, NDArray]:
        for _ in range(STEPS):
            before, now = now, self.step(now, before, load)
        return now, before

    def settled(self, load: NDArray) -> NDArray[np.float32]:
        given = _row(load)
        return self._settled(now=given, before=given, load=given)["found"][0].T


class ReferenceSheet(Oscillators):
    """The verification's, of a sparse Laplacian."""

    def __init__(self, springs: Coefficients, laplacian: sp.csr_matrix) -> None:
        super().__init__(springs, laplacian.toarray().astype(np.float64))


AnySheet = GraphSheet | ReferenceSheet


def _row(nodes: NDArray) -> NDArray[np.float32]:
    return np.ascontiguousarray(np.asarray(nodes, np.float32).T[None])


def masses_of(laplacian: sp.csr_matrix) -> NDArray[np.float64]:
    """(K,) that make the Laplacian symmetric, of mean 1: its left null vector."""
    values, vectors = np.linalg.eig(laplacian.toarray().astype(np.float64).T)
    masses = np.real(vectors[:, np.abs(values).argmin()])
    return masses / masses.mean()
