"""Stage `train-plus` from a forged alignment to a model, and after it was killed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.options import check_options
from bridge.runs import read_artifact
from bridge.tissue.trained_plus import NODE_FIELDS, TrainedPlus
from tests.forged.oscillating import people_of
from tests.tf_dsnet.plus import PEOPLE, TINY, forge_run
from tf_dsnet import stage_train_plus
from tf_dsnet.oscillators.training import PlusTraining
from tf_dsnet.stage_train_plus import PROFILES


@pytest.fixture
def run(runs: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return forge_run(runs, monkeypatch)


def test_stage_leaves_a_model_of_its_people(run):
    stage_train_plus.main(TINY)
    artifact = read_artifact(run / "train_plus")
    artifact.verify()
    assert set(artifact.manifest["files"]) == {"dsnet_plus.safetensors"}
    assert artifact.array("loss_dsnet_plus").shape == (6,)
    assert artifact.manifest["default"] == "dsnet_plus"
    assert set(artifact.manifest["predictors"]) == {"dsnet_plus"}
    assert artifact.manifest["people"] == ["50000", "50001"]
    assert (artifact.manifest["sequences_trained_on"], artifact.origin) == (5, "synthetic")
    assert set(artifact.manifest["upstream"]) == {"align_robust"}
    model = TrainedPlus.load(artifact)
    np.testing.assert_array_equal(model.people_betas, people_of(PEOPLE))
    assert (len(model.nodes), model.look_ahead, model.weights.taps.shape) == (60, 1, (2,))
    assert set(model.weights.base) == set(NODE_FIELDS)
    assert model.weights.residual.shape == (PEOPLE, 60, 1)
    assert model.static.constant_m.shape == (PEOPLE, 6890, 3)
    assert model.static.by_pose_m.shape == (207, 60, 3)


def test_a_misfit_of_each_frame_is_found_at_every_vertex(runs, monkeypatch):
    """Trained a little longer, so that loads explain what they can."""
    run = forge_run(runs, monkeypatch, misfit_m=0.01)
    stage_train_plus.main(replace(TINY, rounds=6, steps=8, window=24, batch_size=5, lr=0.1))
    artifact = read_artifact(run / "train_plus")
    assert artifact.manifest["static"]["chosen"] != "none"
    assert artifact.manifest["static"]["left_out_error"]["constant"] < 0.5
    constant = TrainedPlus.load(artifact).static.constant_m
    np.testing.assert_allclose(constant[..., 1].mean(), 0.01, rtol=0.15)
    np.testing.assert_allclose(constant[..., [0, 2]].mean((0, 1)), 0.0, atol=0.002)


@pytest.mark.parametrize("killed_in", [1])
@pytest.mark.slow
def test_killed_stage_resumes_bit_identically(runs, monkeypatch, killed_in):
    run = forge_run(runs, monkeypatch, misfit_m=0.01)
    stage_train_plus.main(TINY)
    whole = read_artifact(run / "train_plus")
    assert whole.manifest["static"]["chosen"] != "none"
    (run / "train_plus").rename(run / "uninterrupted")
    numbers: list[int] = []
    one_round = PlusTraining.round

    def dying_round(self, number, static_m):
        if number == killed_in and killed_in not in numbers:
            numbers.append(number)
            raise KeyboardInterrupt
        numbers.append(number)
        return one_round(self, number, static_m)

    monkeypatch.setattr(PlusTraining, "round", dying_round)
    with pytest.raises(KeyboardInterrupt):
        stage_train_plus.main(TINY)
    assert not (run / "train_plus").exists()
    stage_train_plus.main(TINY)
    assert numbers == [*range(killed_in + 1), *range(killed_in, 3)]
    assert read_artifact(run / "train_plus").content_sha256 == whole.content_sha256


def test_a_current_result_is_kept(run, monkeypatch):
    stage_train_plus.main(replace(TINY, rounds=1))
    monkeypatch.setattr(PlusTraining, "round", lambda *_: pytest.fail("trained again"))
    stage_train_plus.main(replace(TINY, rounds=1))


def test_the_papers_alignment_is_refused_in_one_line(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, kind="align", aligner="sgd")
    with pytest.raises(DsnetError, match="without an alignment by the robust aligner") as caught:
        stage_train_plus.main(TINY)
    assert "\n" not in str(caught.value)
    assert "dsnet align --aligner both --run tiny" in str(caught.value)
    assert not list(run.glob("*train_plus*"))


def test_a_robust_alignment_in_the_papers_place_is_as_good(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, kind="align", aligner="robust")
    stage_train_plus.main(replace(TINY, rounds=1))
    assert set(read_artifact(run / "train_plus").manifest["upstream"]) == {"align"}


def test_sequences_of_two_and_three_frames_are_refused(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, lengths=(2, 3, 3))
    with pytest.raises(DsnetError, match="at least one of four frames"):
        stage_train_plus.main(TINY)
    assert not list(run.glob("*train_plus*"))


def test_a_loss_that_is_not_finite_names_its_round(run, monkeypatch):
    monkeypatch.setattr(PlusTraining, "round", lambda *_: [math.nan])
    with pytest.raises(DsnetError, match="with a loss of nan in round 1"):
        stage_train_plus.main(TINY)
    assert not list(run.glob("*train_plus*"))


@pytest.mark.parametrize("change", [{"rounds": 0}, {"nodes": 0}, {"lr": math.inf}, {"taps": 0}])
def test_senseless_numbers_are_refused_before_any_work(change):
    with pytest.raises(DsnetError, match="Pass --"):
        check_options(replace(TINY, **change))


def test_every_profile_trains_its_own_run():
    assert {name: config.run for name, config in PROFILES.items()} == {
        name: name for name in ("smoke", "demo", "paper")
    }
