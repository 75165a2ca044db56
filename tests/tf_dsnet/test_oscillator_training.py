"""Training finds the mechanics that made the clips, and comes to the same bits again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.body import BodyModelData
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.trained_plus import StaticPart, TrainedPlus
from bridge.verify.reference.oscillators import coefficients, moving
from tests.forged.oscillating import HZ, clip_of, clips_of, lively, people_of, true_model
from tf_dsnet.oscillators.training import PlusSettings, PlusTraining

NODES = 60
SETTINGS = PlusSettings(
    nodes=NODES, rounds=6, steps=15, window=30, batch_size=9, lr=0.1, taps=2, look_ahead=1
)
NOTHING = StaticPart.nothing()


@pytest.fixture(scope="module")
def nodes(body: BodyModelData) -> TissueNodes:
    return TissueNodes.of(body, NODES)


@pytest.fixture(scope="module")
def truth(nodes: TissueNodes) -> TrainedPlus:
    return true_model(nodes, people_of(4))


def training_of(body, truth: TrainedPlus, settings: PlusSettings = SETTINGS) -> PlusTraining:
    people, clips = clips_of(body, truth)
    return PlusTraining(settings, body, truth.nodes, people, clips)


def rounds(training: PlusTraining, truth: TrainedPlus, body, numbers) -> list[float]:
    _, clips = clips_of(body, truth)
    nothing = [np.zeros_like(clip.offsets_m) for clip in clips]
    return [loss for number in numbers for loss in training.round(number, nothing)]


@pytest.fixture(scope="module")
def trained(body, truth) -> tuple[TrainedPlus, list[float]]:
    training = training_of(body, truth)
    losses = rounds(training, truth, body, range(SETTINGS.rounds))
    return training.trained(NOTHING), losses


def explained(found: np.ndarray, expected: np.ndarray) -> float:
    """R2: the share of the offsets' energy that a prediction explains."""
    return 1 - float(np.square(found - expected).sum() / np.square(expected).sum())


def test_the_loss_falls(trained):
    losses = trained[1]
    assert len(losses) == SETTINGS.rounds * SETTINGS.steps
    assert np.mean(losses[-5:]) < 0.1 * losses[0]


def test_the_frequency_is_found(trained, truth, body):
    for betas in (np.zeros(10), *people_of(4)):
        found = coefficients(trained[0], body, betas).omega / (2 * np.pi)
        expected = coefficients(truth, body, betas).omega / (2 * np.pi)
        assert np.median(found / expected) == pytest.approx(1.0, abs=0.05)
    assert np.median(coefficients(truth, body, np.zeros(10)).omega) == pytest.approx(2 * np.pi * HZ)


def test_a_motion_that_was_left_out_is_predicted(trained, truth, body):
    betas = people_of(4)[1]
    clip = clip_of(body, truth, betas, lively(150, 999))
    assert explained(moving(trained[0], body, lively(150, 999), betas), clip.offsets_m) > 0.95


def test_a_new_persons_softness_follows_from_shape(trained, truth, body):
    betas = people_of(4)[[0, 2]].mean(0) + np.array(
        [0.5, 0, -0.5, 0, 0.5, 0, 0, 0, 0, 0], np.float32
    )
    clip = clip_of(body, truth, betas, lively(150, 998))
    assert explained(moving(trained[0], body, lively(150, 998), betas), clip.offsets_m) > 0.95


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


def test_frames_after_a_clips_end_count_for_nothing(body, truth):
    """A window that is longer than the clip says what one that just fits says."""
    losses = []
    for window in (28, 70):
        settings = replace(SETTINGS, window=window, rounds=1, steps=1, batch_size=3)
        people, clips = clips_of(body, truth, frames=30)
        training = PlusTraining(settings, body, truth.nodes, people, clips)
        losses += training.round(0, [np.zeros_like(clip.offsets_m) for clip in clips])
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)


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
