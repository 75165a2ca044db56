"""A run whose networks are random, one second of motion, a woman whose offsets are known: for
predictions without training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange import save_weights
from bridge.exchange.dsnet import Scaling, TrainedDsnet
from bridge.runs import ArtifactWriter, Run, write_artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import TrainedModel, load_model
from dsnet.verify import draws
from tests.forged.amass import save, smplh
from tests.forged.codec import write_codec
from tests.forged.markers import Known
from tests.forged.plus import soft_flesh, write_plus

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
def mesh_decoder() -> tuple[dict[str, NDArray], dict[str, Any]]:
    """The decoder's weights under PyTorch's names, and its architecture."""
    weights = {name.removeprefix("model."): a for name, a in autoencoder_arrays().items()}
    return weights, {"widths": WIDTHS}


@pytest.fixture(scope="session")
def trained() -> TrainedDsnet:
    """A DSNet with a scaling that matters."""
    rng = np.random.default_rng(4)
    inputs = rng.normal(1.0, rng.uniform(0.01, 3.0, 79), (200, 79))
    latents = rng.normal(-2.0, rng.uniform(0.0, 3.0, 100), (200, 100))
    scaling = Scaling.fitted(inputs, latents, 0.05)
    return TrainedDsnet("dsnet_standardised", draws.dsnet_weights(3), scaling)


@pytest.fixture(scope="session")
def flesh() -> TrainedPlus:
    """A `dsnet_plus` of 60 nodes on the embedded body."""
    return soft_flesh(load_body_model("embedded:female"))


@pytest.fixture
def aligned_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run `r`, aligned with the embedded body, in which nothing is trained."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    return write_aligned(Run("r"))


def write_aligned(run: Run) -> Run:
    body = {"smpl": "embedded:female"}
    write_artifact(run.path / "align", "align", {}, units={}, data="synthetic", config=body)
    return run


@pytest.fixture(scope="session")
def soft(flesh: TrainedPlus, tmp_path_factory: pytest.TempPathFactory) -> TrainedModel:
    """That flesh as a run's predictor."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(tmp_path_factory.mktemp("runs")))
        run = write_aligned(Run("r"))
        write_plus(run, flesh)
        return load_model(run)


@pytest.fixture
def plus_run(aligned_run: Run, flesh: TrainedPlus) -> Run:
    """Run `r` with `dsnet_plus` alone."""
    write_plus(aligned_run, flesh)
    return aligned_run


@pytest.fixture
def trained_run(aligned_run: Run, trained: TrainedDsnet) -> Run:
    """Run `r` with both networks at the body's size."""
    folder = aligned_run.path
    codec = write_codec(folder / "train-ae", autoencoder_arrays(), {"widths": WIDTHS})
    upstream = {"train-ae": codec.content_sha256}
    train = ArtifactWriter(folder / "train", "train", data="synthetic")
    arrays = {"dsnet_standardised": trained.arrays(), "dsnet_faithful": trained.weights}
    for name, stored in arrays.items():
        save_weights(train.file_path(f"{name}.safetensors"), stored)
    train.record(default="dsnet_standardised", predictors={name: {} for name in arrays})
    train.finish(upstream=upstream)
    return aligned_run


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """A file of 31 frames at 60 fps, in AMASS's format, of an embedded body."""
    path = tmp_path / "given" / "a_poses.npz"
    return save(path, smplh(51, 100.0), gender="female", source="synthetic")


@pytest.fixture
def blank_strip(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw nothing, for tests that look at numbers: rendering takes most of a prediction's time."""

    def draw(path: Path, *arguments: object, **options: object) -> None:
        path.write_bytes(b"")

    monkeypatch.setattr("dsnet.pictures.panels.draw_motion_strip", draw)


@pytest.fixture(scope="session")
def known() -> Known:
    """A woman whose flesh is what the packaged model predicts of jumping jacks."""
    path = Path("sample:jumping_jacks")
    trained, motion = Controls().load(None, None, path)
    moving = controlled_body(trained, motion, Controls())
    offsets = np.concatenate([part.offsets_m for part in moving]).astype(np.float64)
    return Known(trained.body, moving.motion, offsets)
