"""What gradients of whole networks and the other engines do not show of the reference's layers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dsnet.verify.reference import layers

RNG = np.random.default_rng(5)
REAL = np.arange(5) < np.array([[5], [2]])


def differences(function: Callable[[np.ndarray], float], x: np.ndarray) -> np.ndarray:
    """Central differences; with steps of 1e-6 exact to about 1e-9 of the function's size."""
    result = np.empty_like(x)
    for index in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[index] = 1e-6
        result[index] = (function(x + step) - function(x - step)) / 2e-6
    return result


@pytest.mark.parametrize("real", [None, REAL], ids=["all", "masked"])
@pytest.mark.parametrize("count_epsilon", [0.0, 0.3])
def test_batch_norm(real, count_epsilon):
    """Also with a divisor that is far from the count, where the mean has a part in the variance."""
    (x, probe), (gamma, beta) = RNG.normal(size=(2, 2, 5, 4)), RNG.normal(size=(2, 4))

    def normalised(x: np.ndarray) -> float:
        batch = layers.moments(x, real, count_epsilon)
        y = layers.batch_norm(x, batch.mean, batch.variance, gamma, beta, 1e-3)
        return float((probe * y).sum())

    batch = layers.moments(x, real, count_epsilon)
    slope, *_ = layers.batch_norm_backward(probe, x, batch, gamma, 1e-3)
    assert_allclose(slope, differences(normalised, x), rtol=1e-6, atol=1e-7)


def test_moments_leave_padding_out():
    x = RNG.normal(size=(2, 5, 4))
    batch = layers.moments(x, REAL, 0.0)
    assert_allclose(batch.mean, x[REAL].mean(axis=0), rtol=1e-12)
    assert_allclose(batch.variance, x[REAL].var(axis=0), rtol=1e-12)


@pytest.mark.parametrize("real", [None, REAL], ids=["all", "masked"])
def test_sum_of_distances(real):
    target, predicted = RNG.normal(size=(2, 2, 5, 4))
    distances = np.sqrt(((predicted - target) ** 2).sum(axis=-1))
    loss, _ = layers.sum_of_distances(target, predicted, real)
    assert_allclose(loss, distances[... if real is None else real].sum() / 2, rtol=1e-12)


def test_a_distance_of_zero_has_no_gradient():
    same = np.ones((1, 2, 3))
    loss, by_predicted = layers.sum_of_distances(same, same)
    assert loss == 0.0
    np.testing.assert_array_equal(by_predicted, 0.0)


def test_sigmoid_never_overflows():
    with np.errstate(all="raise"):
        values = layers.sigmoid(np.array([-1e4, 0.0, 1e4]))
    assert_allclose(values, [0.0, 0.5, 1.0], atol=1e-12)
