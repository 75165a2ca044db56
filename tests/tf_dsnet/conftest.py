"""A small run with the folders that stage `encode` leaves, and weights that are not trivial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.exchange.trained_dsnet import Scaling, TrainedDsnet
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import write_artifact
from tf_dsnet.model import build_dsnet, named_weights

SUBJECTS = ("50004", "50020")
MOTIONS = ("hips", "punching", "one_leg_jump")
LENGTHS = (25, 40, 30, 35, 20, 45)


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


def write_encoded(path: Path) -> None:
    rng = np.random.default_rng(0)
    names = [(subject, motion) for subject in SUBJECTS for motion in MOTIONS]
    sequences, start = [], 0
    for (subject, motion), length in zip(names, LENGTHS, strict=True):
        split = "validation" if (subject, motion) == ("50004", "one_leg_jump") else "train"
        sequences.append(
            MotionSequence(f"{subject}_{motion}", subject, motion, start, length, 60.0, split)
        )
        start += length
    theta = np.concatenate([_smooth_walk(rng, length) for length in LENGTHS])
    push = np.gradient(np.gradient(theta, axis=0), axis=0)
    latents = 5.0 + 20.0 * push @ rng.normal(size=(69, 100))
    write_artifact(
        path,
        "encode",
        {
            "theta": theta.astype(np.float32),
            "betas": rng.normal(size=(len(SUBJECTS), 10)).astype(np.float32),
            "latents": latents.astype(np.float32),
        },
        units={"theta": "rad, then m", "betas": "1", "latents": "latent unit"},
        data="synthetic",
        sequences=to_manifest(sequences),
    )


def _smooth_walk(rng: np.random.Generator, length: int) -> NDArray:
    phases = rng.uniform(0, 2 * np.pi, (1, 69))
    rates = rng.uniform(0.1, 0.3, (1, 69))
    return 0.3 * np.sin(rates * np.arange(length)[:, None] + phases)
