from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from bridge.body import BodyModelData
from tests.one_thread import one_thread as one_thread


@pytest.fixture(scope="session")
def small_body(body) -> BodyModelData:
    """20 vertices, every array dense and random, so that no gradient is zero by accident."""
    rng = np.random.default_rng(5)
    keep = np.linspace(0, body.vertex_count - 1, 20).astype(int)
    return dataclasses.replace(
        body,
        v_template=body.v_template[keep],
        shapedirs=body.shapedirs[keep],
        posedirs=rng.normal(0, 0.01, (20, 3, 207)),
        weights=rng.dirichlet(np.full(24, 0.2), 20),
        J_regressor=sp.csr_matrix(rng.dirichlet(np.full(20, 0.5), 24)),
        faces=np.zeros((0, 3)),
    )


@pytest.fixture
def random_bodies():
    """Make betas (B, 10), pose (B, joints, 3) and trans (B, 3)."""

    def make(count: int, joints: int = 24, angle: float = 0.6, seed: int = 0):
        rng = np.random.default_rng(seed)
        return (
            rng.normal(0, 1, (count, 10)),
            rng.normal(0, angle, (count, joints, 3)),
            rng.normal(0, 1, (count, 3)),
        )

    return make
