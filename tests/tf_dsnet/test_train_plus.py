"""`dsnet_plus` in stage `train`: it finds the mechanics that made the clips, comes to the same bits
again, and goes on after it was killed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import BodyModelData
from bridge.exchange import load_weights
from bridge.exchange.train_options import TrainPlusConfig
from bridge.runs import read_artifact
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.shape import shape_features
from bridge.tissue.trained_plus import NODE_FIELDS, StaticPart, TrainedPlus
from dsnet.prediction.models import simulate_nodes
from dsnet.verify.reference.oscillators import coefficients, node_offsets
from tests.forged.oscillating import HZ, clip_of, clips_of, lively, people_of, true_model
from tests.tf_dsnet.plus import PEOPLE, TINY, forge_run, teach_nothing, train
from tf_dsnet.framework import Tensor
from tf_dsnet.oscillators import Batch, OscillatorLearner
from tf_dsnet.oscillators import _loss as loss_of_windows
from tf_dsnet.train_plus import PlusTraining, explained_by_shape

NODES = 60
SETTINGS = TrainPlusConfig(
    nodes=NODES, rounds=6, steps=12, window=20, batch_size=6, lr=0.1, taps=2, look_ahead=1
)
NOTHING = StaticPart.nothing()


@pytest.fixture(scope="module")
def nodes(body: BodyModelData) -> TissueNodes:
    return TissueNodes.of(body, NODES)


@pytest.fixture(scope="module")
def truth(nodes: TissueNodes) -> TrainedPlus:
    return true_model(nodes, people_of(4))


def training_of(body, truth: TrainedPlus, settings: TrainPlusConfig = SETTINGS) -> PlusTraining:
    clips = clips_of(body, truth)
    return PlusTraining(settings, body, truth.nodes, truth.people_betas, clips, simulate_nodes)


def rounds(training: PlusTraining, truth: TrainedPlus, body, numbers) -> list[float]:
    nothing = [np.zeros_like(clip.offsets_m) for clip in clips_of(body, truth)]
    return [loss for number in numbers for loss in training.round(number, nothing)]


@pytest.fixture(scope="module")
def trained(body, truth) -> tuple[TrainedPlus, list[float]]:
    training = training_of(body, truth)
    losses = rounds(training, truth, body, range(SETTINGS.rounds))
    return training.trained(NOTHING), losses


def explained(found: np.ndarray, expected: np.ndarray) -> float:
    """R2: the share of the offsets' energy that a prediction explains."""
    return 1 - float(np.square(found - expected).sum() / np.square(expected).sum())


def test_the_loss_falls_and_the_frequency_is_found(trained, truth, body):
    losses = trained[1]
    assert len(losses) == SETTINGS.rounds * SETTINGS.steps
    assert np.mean(losses[-5:]) < 0.1 * losses[0]
    for betas in (np.zeros(10), *people_of(4)):
        found = coefficients(trained[0], body, betas).omega / (2 * np.pi)
        expected = coefficients(truth, body, betas).omega / (2 * np.pi)
        assert np.median(found / expected) == pytest.approx(1.0, abs=0.05)
    assert np.median(coefficients(truth, body, np.zeros(10)).omega) == pytest.approx(2 * np.pi * HZ)


def test_a_motion_that_was_left_out_is_predicted(trained, truth, body):
    betas = people_of(4)[1]
    clip = clip_of(body, truth, betas, lively(150, 999))
    assert explained(node_offsets(trained[0], body, lively(150, 999), betas), clip.offsets_m) > 0.95


def test_a_new_persons_softness_follows_from_shape(trained, truth, body):
    betas = people_of(4)[[0, 2]].mean(0) + np.array(
        [0.5, 0, -0.5, 0, 0.5, 0, 0, 0, 0, 0], np.float32
    )
    clip = clip_of(body, truth, betas, lively(150, 998))
    assert explained(node_offsets(trained[0], body, lively(150, 998), betas), clip.offsets_m) > 0.95


def test_what_shapes_tell_of_known_people_is_taken_out_of_what_they_have_besides(body, truth):
    """New people have nothing besides; known ones stay as they are."""
    people, vertices = people_of(4), truth.nodes.vertices
    features = np.stack([shape_features(body, betas, vertices) for betas in people])
    told = 0.3 + features @ truth.weights.slopes
    learned = replace(truth.weights, slopes=0 * truth.weights.slopes, residual=told)
    found = replace(truth, weights=explained_by_shape(learned, features))
    np.testing.assert_allclose(found.weights.slopes, truth.weights.slopes, atol=0.08)
    assert found.weights.residual.std() < 0.2 * told.std()
    for betas, before in zip(people, told, strict=True):
        known = coefficients(found, body, betas)
        expected = {"omega": 1.0, "stiffening": 2.0, "sag": -2.0}
        for name, power in expected.items():
            log = truth.weights.base[name] + power * before
            np.testing.assert_allclose(getattr(known, name), np.exp(log), rtol=0.03)


def test_one_person_tells_nothing_of_shapes(body, truth):
    features = shape_features(body, truth.people_betas[0], truth.nodes.vertices)[None]
    alone = replace(truth.weights, residual=np.full((1, NODES, 1), 0.2, np.float32))
    found = explained_by_shape(alone, features)
    assert not found.slopes.any()
    assert not found.residual.any()
    told = 0.2 + (features @ truth.weights.slopes)[0]
    np.testing.assert_allclose(found.base["omega"] - alone.base["omega"], told, atol=1e-6)


@pytest.mark.slow
def test_training_is_the_same_bits_each_time_and_after_a_restart(body, truth):
    settings = replace(SETTINGS, rounds=3, steps=3)
    once = training_of(body, truth, settings)
    losses = rounds(once, truth, body, range(3))
    begun = training_of(body, truth, settings)
    first = rounds(begun, truth, body, [0])
    resumed = training_of(body, truth, settings)
    resumed.restore(begun.state())
    assert [*first, *rounds(resumed, truth, body, [1, 2])] == losses
    for name, array in once.state().items():
        np.testing.assert_array_equal(resumed.state()[name], array)


@pytest.fixture
def losses_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that say their loss and learn nothing: building a gradient takes seconds."""

    def step(self: OscillatorLearner, batch: Batch) -> Tensor:
        return loss_of_windows(self.offsets(batch), batch["target"], batch["counted"])

    monkeypatch.setattr(OscillatorLearner, "_step", step)


@pytest.mark.usefixtures("losses_alone")
def test_frames_after_a_clips_end_count_for_nothing(body, truth):
    """A window that is longer than the clip says what one that just fits says."""
    losses = []
    for window in (28, 70):
        settings = replace(SETTINGS, window=window, rounds=1, steps=1, batch_size=3)
        clips = clips_of(body, truth, frames=30)
        people = truth.people_betas
        training = PlusTraining(settings, body, truth.nodes, people, clips, simulate_nodes)
        losses += training.round(0, [np.zeros_like(clip.offsets_m) for clip in clips])
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)


@pytest.mark.usefixtures("losses_alone")
def test_windows_start_with_the_datas_own_velocity(body, truth):
    """From it the true coefficients go on as the data do; a wrong one would swing on its own."""
    settings = replace(SETTINGS, taps=1, look_ahead=0, window=20, rounds=3, steps=1)
    training = training_of(body, truth, settings)
    weights = {weight.name: weight for weight in training.layer.weights}
    for name, log in truth.weights.base.items():
        weights[f"log_{name}"].assign(log[0])
    weights["slopes"].assign(truth.weights.slopes)
    weights["stiffening_power"].assign(truth.weights.stiffening_power)
    (loss,) = rounds(training, truth, body, [0])
    assert loss < 1e-3


@pytest.fixture
def run(runs: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return forge_run(runs, monkeypatch)


def test_stage_leaves_a_model_of_its_people(run):
    train()
    artifact = read_artifact(run / "train_plus")
    artifact.verify()
    assert set(artifact.manifest["files"]) == {"dsnet_plus.safetensors"}
    assert artifact.array("loss_dsnet_plus").shape == (6,)
    assert artifact.manifest["default"] == "dsnet_plus"
    assert set(artifact.manifest["predictors"]) == {"dsnet_plus"}
    assert artifact.manifest["people"] == ["50000", "50001"]
    assert artifact.origin == "synthetic"
    assert set(artifact.manifest["upstream"]) == {"align_robust"}
    model = TrainedPlus.load(artifact)
    np.testing.assert_array_equal(model.people_betas, people_of(PEOPLE))
    assert (len(model.nodes), model.look_ahead, model.weights.taps.shape) == (60, 1, (2,))
    assert set(model.weights.base) == set(NODE_FIELDS)
    assert model.weights.residual.shape == (PEOPLE, 60, 1)
    assert model.static.constant_m.shape == (PEOPLE, 6890, 3)
    assert model.static.by_pose_m.shape == (207, 60, 3)


def test_a_misfit_of_each_frame_is_found_at_every_vertex(runs, monkeypatch):
    """Trained a little longer, so that loads explain what they can. Sideways: sag would take some
    of what is down."""
    run = forge_run(runs, monkeypatch, misfit_m=0.01)
    train(replace(TINY, rounds=6, steps=8, window=24, batch_size=5, lr=0.1))
    artifact = read_artifact(run / "train_plus")
    assert artifact.manifest["static"] != "none"
    constant = TrainedPlus.load(artifact).static.constant_m
    np.testing.assert_allclose(constant[..., 2].mean(), 0.01, rtol=0.15)
    np.testing.assert_allclose(constant[..., :2].mean((0, 1)), 0.0, atol=0.002)


@pytest.mark.parametrize("killed_in", [1])
@pytest.mark.slow
def test_killed_stage_resumes_bit_identically(runs, monkeypatch, killed_in):
    run = forge_run(runs, monkeypatch, misfit_m=0.01)
    train()
    whole = read_artifact(run / "train_plus")
    assert whole.manifest["static"] != "none"
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
        train()
    assert not (run / "train_plus").exists()
    (checkpoint,) = run.rglob("checkpoints/dsnet_plus.safetensors")
    static = {n: a.shape for n, a in load_weights(checkpoint).items() if n.startswith("static/")}
    assert static == {"static/constant": (PEOPLE, 60, 3), "static/by_pose": (207, 60, 3)}
    train()
    assert numbers == [*range(killed_in + 1), *range(killed_in, 3)]
    assert read_artifact(run / "train_plus").content_sha256 == whole.content_sha256


def test_the_papers_alignment_is_refused_in_one_line(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, kind="align", config={"aligner": "sgd"})
    with pytest.raises(DsnetError, match="without an alignment by the robust aligner") as caught:
        train()
    assert "\n" not in str(caught.value)
    assert "dsnet align --aligner both --run tiny" in str(caught.value)
    assert not list(run.glob("*train_plus*"))


def test_a_robust_alignment_in_the_papers_place_is_as_good(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, kind="align", config={"aligner": "robust"})
    teach_nothing(monkeypatch)
    train(replace(TINY, rounds=1))
    assert set(read_artifact(run / "train_plus").manifest["upstream"]) == {"align"}


def test_sequences_of_two_and_three_frames_are_refused(runs, monkeypatch):
    run = forge_run(runs, monkeypatch, lengths=(2, 3, 3))
    with pytest.raises(DsnetError, match="at least one of four frames"):
        train()
    assert not list(run.glob("*train_plus*"))


def test_a_loss_that_is_not_finite_names_its_round(run, monkeypatch):
    monkeypatch.setattr(PlusTraining, "round", lambda *_: [math.nan])
    with pytest.raises(DsnetError, match="with a loss of nan in round 1"):
        train()
    assert not list(run.glob("*train_plus*"))
