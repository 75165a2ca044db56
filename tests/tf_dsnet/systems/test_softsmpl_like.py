"""A recurrent network on SoftSMPL's descriptor: what it is told and taught, and what it keeps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.systems.kinematics import deviations_from_rest, rates, root_rates
from benchmarks.systems.pose_code import ENCODER, CodeRates, learn_pose_code
from benchmarks.systems.rate_search import RateSearch
from benchmarks.systems.softsmpl_like import DynamicLoss, SoftSmplLike, mean_sizes
from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange.dsnet import Clips, Scaling, TrainedDsnet, join_inputs
from bridge.exchange.train_options import PredictorSettings
from bridge.motion import pack_theta, unpack_theta
from bridge.paper import N_BETAS
from tests.forged.driven import forged_data, motion, people
from tf_dsnet.framework import be_reproducible, keras
from tf_dsnet.predictors import TrainingData

SETTINGS = PredictorSettings(epochs=8, frames=40, batch_size=3)
ENTRY = SoftSmplLike(pose_steps=60)
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def data(body) -> TrainingData:
    return forged_data(body, clips=6, frames=40)


def run(training: RateSearch, epochs: range) -> RateSearch:
    for number in epochs:
        training.epoch(number, validate=number % 2 == 1)
    return training


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory) -> RateSearch:
    file = tmp_path_factory.mktemp("soft") / "c.safetensors"
    return run(ENTRY.training(SETTINGS, data, file), range(SETTINGS.epochs))


def encoded(weights: dict[str, NDArray], deviations: NDArray) -> NDArray:
    """The pose code (T, 10) in NumPy."""
    first, second = ((weights[f"{n}/kernel"], weights[f"{n}/bias"]) for n in ENCODER)
    return np.maximum(deviations @ first[0] + first[1], 0.0) @ second[0] + second[1]


def test_it_is_told_the_42_numbers_and_betas(trained, body):
    """From theta to the GRU's input, beside the same in NumPy."""
    made = TrainedDsnet.from_arrays("softsmpl_like", trained.arrays())
    theta, betas = motion(30, 5), people(3)[2]
    told = ENTRY.told(join_inputs(theta, betas), lambda: body)
    model = ENTRY.rebuilt(made.weights, told.shape[1])
    upto = keras.Model(model.inputs[0], model.get_layer("descriptor_and_betas").output)
    found = upto(made.scaling.inputs(told)[None]).numpy()[0]
    assert found.shape == (30, 42 + 10)

    code = encoded(dict(made.weights), deviations_from_rest(theta))
    velocity = rates(code, 1.0)
    described = np.concatenate([code, velocity, rates(velocity, 1.0, start=2)], axis=1)
    mean, spread = (made.weights[f"code_rates/{name}"] for name in ("mean", "spread"))
    np.testing.assert_allclose(found[:, :30], (described - mean) / spread, atol=2e-3)
    rest = np.concatenate([root_rates(theta), np.tile(betas, (30, 1))], axis=1)
    scaling = made.scaling
    expected = (rest - scaling.input_mean[189:]) / scaling.input_std[189:]
    np.testing.assert_allclose(found[:, 30:], expected, rtol=1e-4, atol=1e-4)
    assert not scaling.input_mean[:189].any()
    assert (scaling.input_std[:189] == 1).all()


def test_what_it_is_told_is_standardised_over_the_training_frames(trained, data, body):
    made = TrainedDsnet.from_arrays("softsmpl_like", trained.arrays())
    told = [ENTRY.told(clip.inputs, lambda: body) for clip in data.train]
    model = ENTRY.rebuilt(made.weights, told[0].shape[1])
    upto = keras.Model(model.inputs[0], model.get_layer("descriptor_and_betas").output)
    found = np.concatenate([upto(made.scaling.inputs(clip)[None]).numpy()[0] for clip in told])
    np.testing.assert_allclose(found[:, :30].mean(axis=0), 0.0, atol=1e-3)
    np.testing.assert_allclose(found[:, :30].std(axis=0), 1.0, atol=1e-3)


@pytest.mark.parametrize("frames", [1, 2, 3, 9])
def test_rates_of_a_code_are_backward_differences(frames):
    code = RNG.normal(size=(2, frames, 4)).astype(np.float32)
    velocity = np.stack([rates(one, 1.0) for one in code])
    acceleration = np.stack([rates(one, 1.0, start=2) for one in velocity])
    expected = np.concatenate([code, velocity, acceleration], axis=-1)
    np.testing.assert_allclose(CodeRates()(code).numpy(), expected, atol=1e-5)


def test_the_code_is_learned_and_leaves_the_shape_to_the_decoder():
    """Ten directions of poses and ten of shapes are more than a code of ten holds."""
    be_reproducible(0)
    betas, inner = RNG.normal(size=(2, 2000, 10))
    poses = 0.1 * (inner @ RNG.normal(size=(10, 189)) + betas @ RNG.normal(size=(10, 189)))
    weights, losses = learn_pose_code(poses, betas, 200)
    _, untold = learn_pose_code(poses, np.zeros_like(betas), 200)
    assert [kernel.shape for kernel, _ in weights] == [(189, 500), (500, 10)]
    assert np.mean(losses[-20:]) < 0.3 * losses[0]
    assert np.mean(losses[-20:]) < 0.6 * np.mean(untold[-20:])


def test_the_pose_code_stays_as_it_is_while_the_rest_learns(trained):
    before, after = trained._fresh, trained.trainer.state()
    frozen = [name for name in before if name.startswith((*ENCODER, "code_rates"))]
    assert len(frozen) == 6
    for name in frozen:
        np.testing.assert_array_equal(before[name], after[name], err_msg=name)
        assert before[name].any()
    assert np.abs(before["gru/kernel"] - after["gru/kernel"]).max() > 0
    assert trained.parameters()["dsnet_trainable"] == 3 * 256 * (52 + 256 + 2) + 257 * 100


def test_the_loss_sums_relative_errors_of_latents_and_their_rates():
    latents = RNG.normal(size=(2, 9, 100)).astype(np.float32)
    real = np.arange(9) < np.array([[9], [6]])
    clips = Clips(latents, latents, real)
    sizes = mean_sizes(clips)
    parts = [latents[0], latents[1, :6]]
    for order, size in enumerate(sizes):
        changes = np.concatenate([np.diff(part, n=order, axis=0) for part in parts])
        np.testing.assert_allclose(size, np.abs(changes).mean(), rtol=1e-5)
    loss = DynamicLoss(sizes)
    np.testing.assert_allclose(loss(latents, np.zeros_like(latents), real), 3.0, rtol=1e-5)
    np.testing.assert_allclose(loss(latents, latents, real), 0.0)
    # A constant error is one of position alone.
    of_position = float(loss(latents, latents + 0.5, real))
    np.testing.assert_allclose(of_position, 0.5 / sizes[0], rtol=1e-4)
    padded = np.where(real[..., None], latents + 0.5, 1e3).astype(np.float32)
    np.testing.assert_allclose(float(loss(latents, padded, real)), of_position, rtol=1e-5)
    still = Clips(latents, np.zeros_like(latents), real)
    assert mean_sizes(still) == [1.0, 1.0, 1.0]


def test_a_few_epochs_lower_the_loss(trained):
    assert trained.losses[-1] < 0.9 * trained.losses[0]
    assert len(trained.validation_losses) == 4


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
    assert np.abs(one(theta, people(3)[1]) - found).max() > 1e-2 * np.abs(found).max()
    np.testing.assert_allclose(one(theta[:20], clip.betas), found[:20], rtol=1e-4, atol=1e-6)


def test_a_body_that_stands_turned_is_the_same_to_it(trained, body):
    """The heading is told by velocities alone, and there are none."""
    predict = ENTRY.load(trained.arrays(), lambda: body)
    pose, trans = unpack_theta(motion(30, 6))
    trans = np.zeros_like(trans)
    turned = pose.copy()
    turned[:, 0] = (Rotation.from_euler("y", 1.0) * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    one, other = (predict(pack_theta(p, trans), people(3)[0]) for p in (pose, turned))
    np.testing.assert_allclose(other, one, rtol=1e-3, atol=1e-5)


def test_training_that_was_killed_goes_on_bit_identically(trained, data, tmp_path: Path):
    file = tmp_path / "c.safetensors"
    run(ENTRY.training(SETTINGS, data, file), range(1)).save()  # the search has still to begin anew
    again = run(ENTRY.training(SETTINGS, data, file), range(SETTINGS.epochs))
    assert again.losses == trained.losses
    assert again.validation_losses == trained.validation_losses
    expected = trained.arrays()
    for name, array in again.arrays().items():
        np.testing.assert_array_equal(array, expected[name], err_msg=name)


def test_another_networks_weights_are_refused_in_one_line():
    scaling = Scaling.fitted(np.zeros((2, 211)), np.zeros((2, 100)), 1.0)
    other = TrainedDsnet("other", {"fc_1/kernel": np.zeros((3, 3))}, scaling)
    with pytest.raises(DsnetError, match="differ from softsmpl_like's in") as caught:
        ENTRY.load(other.arrays(), lambda: pytest.fail("no body is needed"))
    assert "\n" not in str(caught.value)


def test_it_says_what_is_ours():
    assert (ENTRY.code, ENTRY.masked) == ("pca", True)
    told = " ".join(ENTRY.departures(SETTINGS))
    for word in ("21 joints", "256", "no transfer", "acceleration"):
        assert word in told
