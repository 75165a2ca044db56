"""Mechanics of nodes for tests."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from bridge.tissue.oscillators import NodeMechanics

ALONE = sp.csr_matrix((1, 1), dtype=np.float32)
"""Laplacian of a node without neighbours."""


def mechanics(
    count: int = 1,
    hz: ArrayLike = 5.0,
    damping: ArrayLike = 0.15,
    stiffening: ArrayLike = 0.0,
    wave_speed: ArrayLike = 0.0,
    bending: ArrayLike = 0.0,
    normal_ratio: ArrayLike = 1.0,
    normals: ArrayLike = (0.0, 0.0, 1.0),
    taps: ArrayLike = (1.0,),
    look_ahead: int = 0,
) -> NodeMechanics:
    """Nodes with gains of 1, alike where a number is given."""

    def each(values: ArrayLike) -> NDArray[np.float32]:
        return np.broadcast_to(np.asarray(values, np.float32), count).reshape(count, 1).copy()

    return NodeMechanics(
        omega=each(2 * np.pi * np.asarray(hz)),
        damping_ratio=each(damping),
        stiffening=each(stiffening),
        normal_ratio=each(normal_ratio),
        wave_speed=each(wave_speed),
        bending=each(bending),
        inertia_gain=each(1.0),
        gravity_gain=each(1.0),
        normals=np.broadcast_to(np.asarray(normals, np.float32), (count, 3)),
        taps=np.asarray(taps, np.float32),
        look_ahead=look_ahead,
    )


def masses_of(laplacian: sp.csr_matrix) -> NDArray[np.float64]:
    """(K,) that make the Laplacian symmetric, of mean 1: its left null vector."""
    values, vectors = np.linalg.eig(laplacian.toarray().astype(np.float64).T)
    masses = np.real(vectors[:, np.abs(values).argmin()])
    return masses / masses.mean()
