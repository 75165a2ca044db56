"""The network put together: clip and frames agree, and all of its gradients are right."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bridge.verify.reference import dsnet
from bridge.verify.reference.adam import Arrays

SIZES = {"fc_enc_1": (5, 4), "fc_enc_2": (4, 6), "fc_enc_3": (3, 7)}


REAL = np.arange(6) < np.array([[6], [3], [4]])


@pytest.fixture(scope="module")
def weights() -> Arrays:
    """A narrow DSNet: 5 inputs, 3 LSTM units, 7 latents."""
    rng = np.random.default_rng(8)
    shapes = {f"{name}/kernel": size for name, size in SIZES.items()}
    shapes |= {f"{name}/bias": size[1:] for name, size in SIZES.items()}
    shapes |= {"lstm/kernel": (6, 12), "lstm/recurrent_kernel": (3, 12), "lstm/bias": (12,)}
    drawn = {name: rng.normal(size=shape) for name, shape in shapes.items()}
    norm = {f"batch_norm/{name}": rng.normal(size=3) for name in ("gamma", "beta", "moving_mean")}
    return {**drawn, **norm, "batch_norm/moving_variance": rng.uniform(0.1, 2.0, 3)}


def batch(masked: bool) -> dsnet.Batch:
    rng = np.random.default_rng(9)
    return dsnet.Batch(
        rng.normal(size=(3, 6, 5)) * REAL[..., None],
        rng.normal(size=(3, 6, 7)) * REAL[..., None],
        REAL if masked else None,
    )


def test_frame_by_frame_is_the_whole_clip(weights):
    motion = batch(False).motion
    whole, frames = dsnet.predict(weights, motion), dsnet.predict_by_frames(weights, motion)
    assert list(whole) == list(frames) == list(dsnet.LAYERS)
    for name in dsnet.LAYERS:
        assert_allclose(frames[name], whole[name], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("masked", [False, True])
def test_gradients_of_every_parameter(weights, masked):
    clips = batch(masked)
    gradients = dsnet.learn(weights, clips).gradients
    moving = {"batch_norm/moving_mean", "batch_norm/moving_variance"}
    assert set(gradients) == set(weights) - moving
    rng = np.random.default_rng(0)
    for name, gradient in gradients.items():
        direction = rng.normal(size=gradient.shape)

        def loss(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            return dsnet.learn({**weights, name: weights[name] + step * direction}, clips).loss

        found = (loss(1e-6) - loss(-1e-6)) / 2e-6
        assert_allclose((gradient * direction).sum(), found, rtol=1e-6, atol=1e-8, err_msg=name)


def test_padding_counts_unless_it_is_masked(weights):
    """Noise in the padding changes the faithful loss and statistics, not the masked ones'."""
    for masked in (False, True):
        clips = batch(masked)
        padded = ~REAL[..., None]
        noisy = dsnet.Batch(clips.motion + padded, clips.latents + padded, clips.real)
        before, after = dsnet.learn(weights, clips), dsnet.learn(weights, noisy)
        assert (before.loss == after.loss) == masked
        name = "batch_norm/moving_mean"
        assert np.array_equal(before.statistics[name], after.statistics[name]) == masked


def test_running_statistics_move_a_hundredth(weights):
    clips = batch(False)
    hidden = dsnet.predict(weights, clips.motion)["lstm"]
    moved = dsnet.learn(weights, clips).statistics
    for name, seen in (("mean", hidden.mean((0, 1))), ("variance", hidden.var((0, 1)))):
        before = weights[f"batch_norm/moving_{name}"]
        assert_allclose(moved[f"batch_norm/moving_{name}"], 0.99 * before + 0.01 * seen)
