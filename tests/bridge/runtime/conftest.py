"""A run whose networks are random, and one second of motion, for predictions without training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.exchange import save_weights
from bridge.exchange.trained_dsnet import Scaling, TrainedDsnet
from bridge.runs import ArtifactWriter, Run, write_artifact
from bridge.verify import draws
from tests.forged.amass import save, smplh

WIDTHS = (6890, 12, 8, 6, 4)


def autoencoder_arrays() -> dict[str, NDArray]:
    """What `train-ae` stores: weights in PyTorch's layout, and the normaliser."""
    drawn = draws.autoencoder_weights(1, WIDTHS)
    return {
        **{f"model.{name}": array for name, array in drawn.items()},
        "normaliser.mean_m": np.full((WIDTHS[0], 3), 1e-3, np.float32),
        "normaliser.scale_m": np.full((WIDTHS[0], 3), 2e-3, np.float32),
    }


@pytest.fixture(scope="session")
def trained() -> TrainedDsnet:
    """A DSNet with a scaling that matters."""
    rng = np.random.default_rng(4)
    inputs = rng.normal(1.0, rng.uniform(0.01, 3.0, 79), (200, 79))
    latents = rng.normal(-2.0, rng.uniform(0.0, 3.0, 100), (200, 100))
    scaling = Scaling.fitted(inputs, latents, 0.05)
    return TrainedDsnet("dsnet_standardised", draws.dsnet_weights(3), scaling)


@pytest.fixture
def trained_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trained: TrainedDsnet) -> Run:
    """Run `r`: both networks at the body's size, aligned with the embedded body."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    folder = tmp_path / "runs" / "r"
    write_artifact(
        folder / "align",
        "align",
        {},
        units={},
        data="synthetic",
        config={"smpl": "embedded:female"},
    )
    codec = ArtifactWriter(folder / "train-ae", "train-ae", data="synthetic")
    save_weights(codec.file_path("autoencoder.safetensors"), autoencoder_arrays())
    codec.record(architecture={"widths": WIDTHS, "activation": "leaky_relu", "negative_slope": 0.1})
    upstream = {"train-ae": codec.finish().content_sha256}
    train = ArtifactWriter(folder / "train", "train", data="synthetic")
    arrays = {"dsnet_standardised": trained.arrays(), "dsnet_faithful": trained.weights}
    for name, stored in arrays.items():
        save_weights(train.file_path(f"{name}.safetensors"), stored)
    train.record(default="dsnet_standardised", predictors={name: {} for name in arrays})
    train.finish(upstream=upstream)
    return Run("r")


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """An AMASS file of 31 frames at 60 fps."""
    return save(tmp_path / "given" / "a_poses.npz", smplh(51, 100.0), gender="female")


@pytest.fixture
def blank_strip(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw nothing, for tests that look at numbers: rendering takes most of a prediction's time."""

    def draw(path: Path, *arguments: object, **options: object) -> None:
        path.write_bytes(b"")

    monkeypatch.setattr("bridge.runtime.predict_motion.draw_motion_strip", draw)
