"""The loss against NumPy, and its gradient where a distance vanishes."""

from __future__ import annotations

import numpy as np

from tf_dsnet.framework import tf
from tf_dsnet.losses import sum_of_distances

RNG = np.random.default_rng(0)
TARGET, PREDICTED = RNG.normal(size=(2, 3, 7, 100))
REAL = np.arange(7) < np.array([7, 4, 1])[:, None]
REAL_FRAMES = tf.constant(REAL)


def gradient(target, predicted, real=None):
    variable = tf.Variable(predicted)
    with tf.GradientTape() as tape:
        loss = sum_of_distances(target, variable, real)
    return np.asarray(tape.gradient(loss, variable))


def test_loss_is_the_sum_over_time_of_unsquared_distances():
    expected = np.linalg.norm(PREDICTED - TARGET, axis=-1).sum(axis=1).mean()
    np.testing.assert_allclose(sum_of_distances(TARGET, PREDICTED), expected, rtol=1e-12)


def test_masked_loss_counts_real_frames_only():
    distances = np.linalg.norm(PREDICTED - TARGET, axis=-1)
    expected = sum(distances[clip, :length].sum() for clip, length in enumerate((7, 4, 1))) / 3
    np.testing.assert_allclose(
        sum_of_distances(TARGET, PREDICTED, REAL_FRAMES), expected, rtol=1e-12
    )
    assert not gradient(TARGET, PREDICTED, REAL_FRAMES)[~REAL].any()


def test_gradient_is_a_unit_vector_a_clip():
    expected = (PREDICTED - TARGET) / np.linalg.norm(PREDICTED - TARGET, axis=-1, keepdims=True)
    np.testing.assert_allclose(gradient(TARGET, PREDICTED), expected / 3, rtol=1e-12)


def test_gradient_is_finite_at_and_near_zero():
    target = np.zeros((1, 3, 100), np.float32)
    predicted = target.copy()
    predicted[0, 1, 0] = 1e-30
    predicted[0, 2, 0] = 1e-6
    found = gradient(target, predicted)
    assert np.isfinite(found).all()
    assert not found[0, 0].any()
    np.testing.assert_allclose(found[0, 2, 0], 1.0, rtol=1e-5)
