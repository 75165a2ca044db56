"""`dsnet_differences` from training to predictions, and what refuses it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange.trained_dsnet import load_trained_dsnet
from bridge.runs import Artifact, read_artifact
from bridge.runtime.dsnet_step import DsnetModel
from bridge.runtime.stepping import codes_of
from bridge.runtime.streams.streaming import StreamingPredictor
from tf_dsnet import stage_predict, stage_train
from tf_dsnet.predictors import BOTH_PRESETS, PREDICTORS, load_predictor
from tf_dsnet.stage_predict import PredictStageConfig
from tf_dsnet.stage_train import TrainConfig

NAME = "dsnet_differences"
NO_BODY = partial(pytest.fail, "it was not to ask for a body")
TINY = TrainConfig(
    run="tiny", epochs=3, frames=32, validate_every=2, checkpoint_every=2, predictors=(NAME,)
)
RNG = np.random.default_rng(8)
THETA, BETAS = np.cumsum(RNG.normal(0, 0.05, (30, 69)), axis=0), RNG.normal(size=10)


@pytest.fixture
def trained(encoded_run: Path) -> Artifact:
    stage_train.main(TINY)
    return read_artifact(encoded_run / "train")


def test_it_is_trained_only_when_asked_for():
    assert NAME in PREDICTORS
    assert NAME not in BOTH_PRESETS == TrainConfig().predictors


def test_it_says_what_it_is(trained):
    entry = trained.manifest["predictors"][NAME]
    assert (entry["label"], entry["preset"]) == ("DSNet, pose differences", "differences")
    told = "148 inputs: betas and theta's first and second differences"
    assert entry["departures"][0] == told
    assert "standardised" in entry["departures"][1]
    assert trained.manifest["parameters"]["dsnet"] == 65_140 + 69 * 64


def test_the_papers_network_is_counted_where_both_are_trained(encoded_run):
    stage_train.main(replace(TINY, predictors=("dsnet_faithful", NAME)))
    made = read_artifact(encoded_run / "train")
    assert made.manifest["parameters"] == {"dsnet": 65_140, "dsnet_trainable": 65_020}


def test_frame_by_frame_is_the_whole_clip(trained):
    whole = load_predictor(trained, NAME, NO_BODY)(THETA, BETAS)
    loaded = load_trained_dsnet(trained, NAME)
    stepped = np.stack([*codes_of(DsnetModel(loaded), THETA, BETAS)])
    np.testing.assert_allclose(stepped, whole, rtol=1e-4, atol=1e-4)


def test_it_does_not_know_where_it_is(trained):
    predict = load_predictor(trained, NAME, NO_BODY)
    here, there = (predict(THETA + by, BETAS) for by in (0.0, 2.0))
    np.testing.assert_allclose(here, there, rtol=1e-3, atol=1e-3)
    assert np.abs(here - predict(2 * THETA, BETAS)).max() > 1e-2


def test_later_stages_take_it_by_name(trained, encoded_run):
    stage_predict.main(PredictStageConfig("tiny"))
    made = read_artifact(encoded_run / "predict")
    assert made.manifest["predictors"] == {NAME: "DSNet, pose differences"}
    assert made.array(f"latents_{NAME}").shape == (195, 100)


def test_streaming_poses_refuses_it_in_one_line(trained):
    with pytest.raises(DsnetError, match=r"told of pose differences; expected .* 79 numbers") as no:
        StreamingPredictor("tiny")
    assert "\n" not in str(no.value)
