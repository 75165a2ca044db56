"""`dsnet_plus` without one of its parts, as the ablation trains it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.prediction import ablation, lesser_plus
from benchmarks.prediction.lesser_plus import LesserPlusConfig
from bridge.runs import read_artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.stages import stage_train
from dsnet.stages.stage_train import TrainConfig
from tests.tf_dsnet import plus
from tests.tf_dsnet.plus import TINY, forge_run

PARTS = ("gravity", "coupling", "bending", "stiffening", "sag", "anisotropy", "by_shape",
         "through_time", "static")  # fmt: skip


def test_the_ablation_leaves_out_each_part():
    options = [f"--no-{part.replace('_', '-')}" for part in PARTS]
    asked = [o for row in ablation.VARIANTS.values() for o in row if o.startswith("--no-")]
    assert asked == options


@pytest.fixture
def train(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, misfit_m=0.01)
    tiny = TrainConfig(run="tiny", rounds=TINY.rounds, plus=TINY)
    monkeypatch.setitem(stage_train.PROFILES, "demo", tiny)

    def of(**without: Any):
        lesser_plus.main(LesserPlusConfig(run="tiny", **without))
        artifact = read_artifact(run / "train_plus")
        return artifact, TrainedPlus.load(artifact)

    return of


def test_with_all_parts_it_is_what_the_stage_trains(train, runs):
    artifact, lesser = train()
    assert artifact.manifest["static"] != "none"
    plus.train()
    whole = TrainedPlus.load(read_artifact(runs / "tiny" / "train_plus"))
    for name, array in whole.arrays().items():
        np.testing.assert_array_equal(lesser.arrays()[name], array, err_msg=name)


def test_what_is_left_out_does_nothing_and_the_rest_is_learned(train):
    artifact, model = train(gravity=False, coupling=False, by_shape=False, static=False)
    for name in ("gravity_gain", "wave_speed", "bending"):
        np.testing.assert_allclose(model.weights.base[name], np.log(1e-6), rtol=1e-6)
    assert not model.weights.slopes.any()
    assert np.ptp(model.weights.base["omega"]) > 0
    assert artifact.manifest["config"]["gravity"] is False
    assert artifact.manifest["static"] == "none"
    assert not model.static.constant_m.any()
