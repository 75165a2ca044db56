"""Systems that are there to be compared with: their parts, against laws that are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.prediction import lesser_plus
from benchmarks.prediction.lesser_plus import LesserPlusConfig
from benchmarks.systems import dyna_like
from benchmarks.systems.casas_otaduy_like import TwoFrameNetwork
from benchmarks.systems.kinematics import KINEMATICS_SIZE, kinematics
from bridge.exchange.train_options import PredictorSettings
from bridge.motion import pack_theta
from bridge.paper import N_BETAS
from bridge.runs import read_artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.stages import stage_train
from dsnet.stages.stage_train import TrainConfig
from tests.forged.driven import forged_data
from tests.forged.lively import lively
from tests.tf_dsnet.plus import TINY, forge_run
from tf_dsnet.framework import be_reproducible
from tf_dsnet.model import assign_weights, named_weights


def test_a_motion_that_was_left_out_is_rolled_to_its_latents(body, tmp_path, monkeypatch):
    """Far from what one-step errors promise: many frames on predictions alone."""
    monkeypatch.setattr(dyna_like, "RIDGES", dyna_like.RIDGES[:1])
    data, entry = forged_data(body, clips=18, frames=150), dyna_like.DynaLike()
    training = entry.training(PredictorSettings(epochs=1), data, tmp_path / "c.safetensors")
    training.epoch(0, validate=True)
    predict = entry.load(training.arrays(), lambda: body)
    (clip,) = data.validation
    found = predict(clip.inputs[:, N_BETAS:], clip.betas)
    assert (found.shape, found.dtype) == (clip.latents.shape, np.float32)
    missed = np.square(found - clip.latents).sum() / np.square(clip.latents).sum()
    assert missed < 0.01


FPS = 60.0
FRAMES = len(lively())


def turning(joint: int, rad_s: NDArray, start: Rotation) -> NDArray:
    """A body that stands, but for one joint at a constant rate in its own frame."""
    pose = np.zeros((FRAMES, 22, 3))
    steps = Rotation.from_rotvec(np.arange(FRAMES)[:, None] / FPS * rad_s)
    pose[:, joint] = (start * steps).as_rotvec()
    return pack_theta(pose, np.zeros((FRAMES, 3)))


@pytest.mark.parametrize(("joint", "column"), [(0, 6), (1, 12), (5, 24), (21, 72)])
def test_a_constant_turn_has_a_constant_rate_in_every_frame(joint, column):
    rad_s = np.array([3.0, -5.0, 8.0])  # more than a whole turn, through pi
    found = kinematics(turning(joint, rad_s, Rotation.from_rotvec([0.3, 2.0, -0.4])))
    assert found.shape == (FRAMES, KINEMATICS_SIZE) == (FRAMES, 138)
    np.testing.assert_allclose(found[1:, column : column + 3], np.tile(rad_s, (FRAMES - 1, 1)))
    found[:, column : column + 3] = 0.0
    np.testing.assert_allclose(found, 0.0, atol=1e-8)


SETTINGS = PredictorSettings(epochs=12, frames=64, batch_size=4)
RNG = np.random.default_rng(3)


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
