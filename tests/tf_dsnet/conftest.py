"""A small run with the folders that stage `encode` leaves, and weights that are not trivial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.exchange.dsnet import Scaling, TrainedDsnet
from tests.forged.encoded import write_encoded
from tf_dsnet.model import build_dsnet, named_weights


@pytest.fixture(scope="session")
def weights() -> dict[str, NDArray]:
    """Random weights, statistics included: no zero biases, no unit variances."""
    rng = np.random.default_rng(3)
    drawn = {
        name: array + rng.normal(scale=0.2, size=array.shape).astype(np.float32)
        for name, array in named_weights(build_dsnet()).items()
    }
    drawn["batch_norm/moving_variance"] = rng.uniform(0.1, 2.0, 60).astype(np.float32)
    return drawn


@pytest.fixture(scope="session")
def trained_dsnet(weights: dict[str, NDArray]) -> TrainedDsnet:
    """A network with a scaling that matters."""
    rng = np.random.default_rng(4)
    inputs = rng.normal(1.0, rng.uniform(0.01, 3.0, 79), (200, 79))
    latents = rng.normal(-2.0, rng.uniform(0.0, 3.0, 100), (200, 100))
    return TrainedDsnet("dsnet_standardised", weights, Scaling.fitted(inputs, latents, 0.05))


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in place of runs/."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


@pytest.fixture
def encoded_run(runs: Path) -> Path:
    """Run `tiny` with a finished `encode`: latents that a motion's past decides."""
    write_encoded(runs / "tiny" / "encode")
    return runs / "tiny"
