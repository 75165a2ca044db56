"""`dsnet_differences`: what it is told, and from training to predictions."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.systems.kinematics import pose_differences
from bridge import DsnetError
from bridge.exchange.dsnet import join_inputs
from bridge.runs import Artifact, read_artifact
from dsnet.stages import stage_infer, stage_train
from dsnet.stages.stage_infer import InferConfig
from dsnet.stages.stage_train import TrainConfig
from dsnet.stream.streaming_predictor import StreamingPredictor
from tests.tf_dsnet.trained import train_in
from tf_dsnet.predictors import load_predictor

NAME = "dsnet_differences"
NO_BODY = partial(pytest.fail, "it was not to ask for a body")
TINY = TrainConfig(
    run="tiny", epochs=3, frames=32, validate_every=2, checkpoint_every=2, predictors=(NAME,)
)
RNG = np.random.default_rng(8)
THETA, BETAS = np.cumsum(RNG.normal(0, 0.05, (30, 69)), axis=0), RNG.normal(size=10)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which it was trained."""
    return train_in(tmp_path_factory.mktemp("differences"), TINY)


@pytest.fixture
def trained(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Artifact:
    monkeypatch.setenv("DSNET_RUNS", str(folder.parent))
    return read_artifact(folder / "train")


def test_it_says_what_it_is(trained):
    entry = trained.manifest["predictors"][NAME]
    assert entry["label"] == "DSNet, pose differences"
    told = "148 inputs: betas and theta's first and second differences"
    assert entry["departures"][0] == told
    assert "standardised" in entry["departures"][1]
    assert trained.manifest["parameters"]["dsnet"] == 65_140 + 69 * 64


def test_the_papers_network_is_counted_where_both_are_trained(encoded_run):
    stage_train.main(replace(TINY, epochs=1, predictors=("dsnet_faithful", NAME)))
    made = read_artifact(encoded_run / "train")
    assert made.manifest["parameters"] == {"dsnet": 65_140, "dsnet_trainable": 65_020}


def test_it_does_not_know_where_it_is(trained):
    predict = load_predictor(trained, NAME, NO_BODY)
    here, there = (predict(THETA + by, BETAS) for by in (0.0, 2.0))
    np.testing.assert_allclose(here, there, rtol=1e-3, atol=1e-3)
    assert np.abs(here - predict(2 * THETA, BETAS)).max() > 1e-2


@pytest.mark.usefixtures("trained")
def test_later_stages_take_it_by_name(folder):
    stage_infer.main(InferConfig("tiny"))
    made = read_artifact(folder / "infer")
    assert made.manifest["predictors"] == {NAME: "DSNet, pose differences"}
    assert made.array(f"latents_{NAME}").shape == (195, 100)


def test_streams_and_motions_refuse_it_in_one_line(trained):
    with pytest.raises(DsnetError, match=r"differences', whose input has 148 numbers") as refused:
        StreamingPredictor("tiny")
    assert "\n" not in str(refused.value)


def test_differences_are_those_of_a_parabola():
    """theta = p + v t + a t^2 / 2 changes by v - a / 2 + a t a frame, and that by a."""
    start, speed, acceleration = RNG.normal(size=(3, 69))
    frames = np.arange(20.0)[:, None]
    theta = start + speed * frames + acceleration * frames**2 / 2
    betas = RNG.normal(size=10)
    found = pose_differences(join_inputs(theta, betas))
    assert found.shape == (20, 148)
    np.testing.assert_array_equal(found[:, :10], np.tile(betas, (20, 1)))
    first, second = found[:, 10:79] / 6, found[:, 79:] / 36
    expected = speed + acceleration * (frames[1:] - 0.5)
    np.testing.assert_allclose(first[1:], expected, atol=1e-12)
    np.testing.assert_allclose(second[2:], np.tile(acceleration, (18, 1)), atol=1e-12)
    assert not first[0].any()
    assert not second[:2].any()


@pytest.mark.parametrize("frames", [1, 2])
def test_the_shortest_motions_have_no_differences_to_tell(frames):
    found = pose_differences(np.zeros((frames, 79)))
    np.testing.assert_array_equal(found, np.zeros((frames, 148)))
