"""`dsnet_plus` without one of its parts, as the ablation trains it."""

from __future__ import annotations

import numpy as np

from benchmarks.prediction import lesser_plus
from benchmarks.prediction.lesser_plus import LesserPlusConfig
from bridge.runs import read_artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.stages import stage_train
from dsnet.stages.stage_train import TrainConfig
from tests.tf_dsnet.plus import TINY, forge_run


def test_what_is_left_out_does_nothing_and_the_rest_is_learned(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, misfit_m=0.01)
    tiny = TrainConfig(run="tiny", rounds=TINY.rounds, plus=TINY)
    monkeypatch.setitem(stage_train.PROFILES, "demo", tiny)
    without = dict.fromkeys(("gravity", "coupling", "by_shape", "static"), False)
    lesser_plus.main(LesserPlusConfig(run="tiny", **without))
    artifact = read_artifact(run / "train_plus")
    model = TrainedPlus.load(artifact)
    for name in ("gravity_gain", "wave_speed", "bending"):
        np.testing.assert_allclose(model.weights.base[name], np.log(1e-6), rtol=1e-6)
    assert not model.weights.slopes.any()
    assert np.ptp(model.weights.base["omega"]) > 0
    assert artifact.manifest["static"] == "none"
    assert not model.static.constant_m.any()
