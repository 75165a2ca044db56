"""A network of two past frames: it learns from given ones and predicts from its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.systems.casas_otaduy_like import (
    CasasOtaduyLike,
    TwoFrameNetwork,
    mean_squared_distance,
    second_differences,
)
from benchmarks.systems.history_noise import HistoryNoise
from benchmarks.systems.rate_search import RateSearch
from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange.dsnet import Clips, Scaling, TrainedDsnet
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import N_BETAS
from tests.forged.driven import forged_data, people
from tf_dsnet.framework import be_reproducible, tf
from tf_dsnet.model import assign_weights, named_weights
from tf_dsnet.predictors import TrainingData

SETTINGS = PredictorSettings(epochs=12, frames=64, batch_size=4)
ENTRY = CasasOtaduyLike()
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def data(body) -> TrainingData:
    return forged_data(body, clips=9, frames=64)


def run(training: RateSearch, epochs: range) -> RateSearch:
    for number in epochs:
        training.epoch(number, validate=number % 3 == 2)
    return training


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory) -> RateSearch:
    file = tmp_path_factory.mktemp("casas") / "c.safetensors"
    return run(ENTRY.training(SETTINGS, data, file), range(SETTINGS.epochs))


@pytest.fixture
def network() -> TwoFrameNetwork:
    """With weights that matter everywhere, and no noise."""
    be_reproducible(1)
    made = TwoFrameNetwork("two_frames")
    biases = {name: array for name, array in named_weights(made).items() if "bias" in name}
    drawn = {name: RNG.normal(scale=0.1, size=array.shape) for name, array in biases.items()}
    assign_weights(made, {**named_weights(made), **drawn})
    return made


def one_frame(weights: dict[str, NDArray], inputs: NDArray) -> NDArray:
    """The network's step from (..., 338) in NumPy."""
    for layer in ("fc_1", "fc_2"):
        inputs = np.maximum(inputs @ weights[f"{layer}/kernel"] + weights[f"{layer}/bias"], 0.0)
    return inputs @ weights["fc_3/kernel"] + weights["fc_3/bias"]


def test_it_has_the_size_that_it_says(network):
    weights = named_weights(network)
    assert weights["fc_1/kernel"].shape == (338, 512)
    assert weights["fc_2/kernel"].shape == (512, 512)
    assert weights["fc_3/kernel"].shape == (512, 100)


def test_predictions_feed_on_themselves_from_zero(network):
    motion = RNG.normal(size=(2, 7, 138)).astype(np.float32)
    weights = named_weights(network)
    one, two = np.zeros((2, 100)), np.zeros((2, 100))
    expected = []
    for frame in range(7):
        now = one_frame(weights, np.concatenate([motion[:, frame], one, two], axis=1))
        expected.append(now)
        one, two = now, one
    found = network(motion, training=False).numpy()
    np.testing.assert_allclose(found, np.stack(expected, axis=1), rtol=1e-4, atol=1e-5)


def test_predictions_know_no_targets_and_no_padding(network):
    inputs = RNG.normal(size=(2, 7, 338)).astype(np.float32)
    other = inputs.copy()
    other[..., 138:] += 5.0
    real = np.ones((2, 7), bool)
    found = network(inputs, training=False).numpy()
    np.testing.assert_array_equal(network([other, real], training=False).numpy(), found)
    assert np.abs(network(other, training=True) - network(inputs, training=True)).max() > 0.1


def test_training_is_told_the_true_past(network):
    inputs = RNG.normal(size=(2, 7, 338)).astype(np.float32)
    found = network(inputs, training=True).numpy()
    np.testing.assert_allclose(found, one_frame(named_weights(network), inputs), atol=1e-4)


def test_examples_hold_the_two_frames_before():
    latents = RNG.normal(size=(3, 9, 100)).astype(np.float32)
    clips = Clips(RNG.normal(size=(3, 9, 138)).astype(np.float32), latents, np.ones((3, 9), bool))
    inputs = ENTRY.examples(clips).inputs
    assert inputs.shape == (3, 9, 338)
    np.testing.assert_array_equal(inputs[..., :138], clips.inputs)
    np.testing.assert_array_equal(inputs[:, 1:, 138:238], latents[:, :-1])
    np.testing.assert_array_equal(inputs[:, 2:, 238:], latents[:, :-2])
    assert not inputs[:, 0, 138:].any()
    assert not inputs[:, 1, 238:].any()


def test_noise_has_its_spread_and_new_draws_that_can_be_taken_up_again():
    layer = HistoryNoise()
    layer.build((None, None, 2))
    layer.set_spread(np.array([0.5, 3.0]))
    values = tf.zeros((40, 500, 2))
    draws = [layer(values).numpy() for _ in range(2)]
    np.testing.assert_allclose(draws[0].std(axis=(0, 1)), [0.5, 3.0], rtol=0.03)
    np.testing.assert_allclose(draws[0].mean(axis=(0, 1)), 0.0, atol=0.1)
    assert np.abs(draws[0] - draws[1]).max() > 0.5
    layer.draws.assign([1])
    np.testing.assert_array_equal(layer(values).numpy(), draws[1])


def test_noise_is_what_going_on_as_before_misses():
    frames = np.arange(20.0)
    latents = np.zeros((2, 25, 100), np.float32)
    latents[:, :20, 0] = 3.0 * frames  # straight on: nothing missed
    latents[:, :20, 1] = 0.5 * 0.2 * frames**2
    latents[:, 20:] = 100.0
    found = second_differences(Clips(latents, latents, np.tile(np.arange(25) < 20, (2, 1))))
    np.testing.assert_allclose(found[:2], [0.0, 0.2], atol=1e-5)
    nothing = np.zeros((1, 2, 100), np.float32)
    assert not second_differences(Clips(nothing, nothing, np.ones((1, 2), bool))).any()


def test_the_loss_is_the_mean_square_of_distances_of_real_frames():
    target, predicted = (RNG.normal(size=(2, 6, 100)).astype(np.float32) for _ in range(2))
    real = np.arange(6) < np.array([[6], [3]])
    squares = np.square(target - predicted).sum(axis=-1)
    found = [float(mean_squared_distance(target, predicted, mask)) for mask in (real, None)]
    np.testing.assert_allclose(found, [squares[real].mean(), squares.mean()], rtol=1e-5)


def test_a_few_epochs_lower_both_losses(trained):
    assert trained.losses[-1] < 0.5 * trained.losses[0]
    assert trained.validation_losses[-1] < 0.9 * trained.validation_losses[0]
    assert trained.parameters()["dsnet_trainable"] == 338 * 512 + 512 * 512 + 512 * 100 + 1124


def test_stored_weights_predict_the_same(trained, data, body, tmp_path):
    arrays = trained.arrays()
    save_weights(tmp_path / "w.safetensors", arrays)
    one, again = (
        ENTRY.load(a, lambda: body) for a in (arrays, load_weights(tmp_path / "w.safetensors"))
    )
    (clip,) = data.validation
    theta = clip.inputs[:, N_BETAS:]
    found = one(theta, clip.betas)
    assert found.shape == clip.latents.shape
    np.testing.assert_array_equal(again(theta, clip.betas), found)
    np.testing.assert_array_equal(one(theta, people(3)[1]), found)  # of any person alike
    np.testing.assert_allclose(one(theta[:20], clip.betas), found[:20], rtol=1e-4, atol=1e-6)


def test_training_that_was_killed_goes_on_bit_identically(trained, data, tmp_path: Path):
    file = tmp_path / "c.safetensors"
    run(ENTRY.training(SETTINGS, data, file), range(7)).save()
    again = run(ENTRY.training(SETTINGS, data, file), range(SETTINGS.epochs))
    assert again.losses == trained.losses
    assert again.validation_losses == trained.validation_losses
    expected = trained.arrays()
    for name, array in again.arrays().items():
        np.testing.assert_array_equal(array, expected[name], err_msg=name)
    assert again.trainer.state()["noise/draws"] == trained.trainer.state()["noise/draws"] > 0


def test_another_networks_weights_are_refused_in_one_line():
    scaling = Scaling.fitted(np.zeros((2, 211)), np.zeros((2, 100)), 1.0)
    other = TrainedDsnet("other", {"fc_1/kernel": np.zeros((3, 3))}, scaling)
    with pytest.raises(DsnetError, match="differ from casas_otaduy_like's in") as caught:
        ENTRY.load(other.arrays(), lambda: pytest.fail("no body is needed"))
    assert "\n" not in str(caught.value)


def test_it_says_what_is_ours():
    assert (ENTRY.code, ENTRY.masked) == ("pca", True)
    told = " ".join(ENTRY.departures(SETTINGS))
    for word in ("512", "noise", "no betas", "its own past alone"):
        assert word in told
