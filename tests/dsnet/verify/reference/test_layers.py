"""Every hand-written gradient against central differences in float64."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dsnet.verify.reference import layers

RNG = np.random.default_rng(5)


def differences(function: Callable[[np.ndarray], float], x: np.ndarray) -> np.ndarray:
    """Central differences; with steps of 1e-6 exact to about 1e-9 of the function's size."""
    result = np.empty_like(x)
    for index in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[index] = 1e-6
        result[index] = (function(x + step) - function(x - step)) / 2e-6
    return result


def assert_gradients(
    function: Callable[..., np.ndarray], slopes: tuple[np.ndarray, ...], *arguments: np.ndarray
) -> None:
    """`slopes` are the gradients of sum(probe * function(*arguments)) by each argument."""
    for place, (given, expected) in enumerate(zip(slopes, arguments, strict=True)):

        def scalar(x: np.ndarray, place: int = place) -> float:
            return float((PROBE * function(*arguments[:place], x, *arguments[place + 1 :])).sum())

        assert_allclose(given, differences(scalar, expected), rtol=1e-6, atol=1e-7)


X, PROBE = RNG.normal(size=(2, 5, 3)), RNG.normal(size=(2, 5, 4))
KERNEL, BIAS = RNG.normal(size=(3, 4)), RNG.normal(size=4)


def test_dense():
    assert_gradients(layers.dense, layers.dense_backward(PROBE, X, KERNEL), X, KERNEL, BIAS)


def test_lstm():
    kernel, recurrent = RNG.normal(size=(3, 16)), RNG.normal(size=(4, 16))
    bias = RNG.normal(size=16)

    def hidden(x: np.ndarray, *weights: np.ndarray) -> np.ndarray:
        return np.stack([step.hidden for step in layers.lstm(x, *weights)], axis=1)

    steps = layers.lstm(X, kernel, recurrent, bias)
    slopes = layers.lstm_backward(PROBE, X, steps, kernel, recurrent)
    assert_gradients(hidden, slopes, X, kernel, recurrent, bias)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("count_epsilon", [0.0, 0.3])
def test_batch_norm(masked, count_epsilon):
    """Also with a divisor that is far from the count, where the mean has a part in the variance."""
    x, gamma, beta = RNG.normal(size=(2, 5, 4)), RNG.normal(size=4), RNG.normal(size=4)
    real = np.arange(5) < np.array([[5], [2]]) if masked else None

    def normalised(x: np.ndarray, gamma: np.ndarray, beta: np.ndarray) -> np.ndarray:
        batch = layers.moments(x, real, count_epsilon)
        return layers.batch_norm(x, batch.mean, batch.variance, gamma, beta, 1e-3)

    batch = layers.moments(x, real, count_epsilon)
    slopes = layers.batch_norm_backward(PROBE, x, batch, gamma, 1e-3)
    assert_gradients(normalised, slopes, x, gamma, beta)


def test_moments_leave_padding_out():
    x, real = RNG.normal(size=(2, 5, 4)), np.arange(5) < np.array([[5], [2]])
    batch = layers.moments(x, real, 0.0)
    assert_allclose(batch.mean, x[real].mean(axis=0), rtol=1e-12)
    assert_allclose(batch.variance, x[real].var(axis=0), rtol=1e-12)


def test_leaky_relu():
    z = RNG.normal(size=(4, 5))
    found = differences(lambda z: float(layers.leaky_relu(z)[0].sum()), z)
    assert_allclose(layers.leaky_relu(z)[1], found, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("masked", [False, True])
def test_sum_of_distances(masked):
    target, predicted = RNG.normal(size=(2, 2, 5, 4))
    real = np.arange(5) < np.array([[5], [2]]) if masked else None
    loss, by_predicted = layers.sum_of_distances(target, predicted, real)
    found = differences(lambda p: layers.sum_of_distances(target, p, real)[0], predicted)
    assert_allclose(by_predicted, found, rtol=1e-6, atol=1e-8)
    distances = np.sqrt(((predicted - target) ** 2).sum(axis=-1))
    kept = distances if real is None else distances[real]
    assert_allclose(loss, kept.sum() / 2, rtol=1e-12)


def test_a_distance_of_zero_has_no_gradient():
    same = np.ones((1, 2, 3))
    loss, by_predicted = layers.sum_of_distances(same, same)
    assert loss == 0.0
    np.testing.assert_array_equal(by_predicted, 0.0)


def test_mean_squared_error():
    target, predicted = RNG.normal(size=(2, 4, 3))
    loss, by_predicted = layers.mean_squared_error(target, predicted)
    found = differences(lambda p: layers.mean_squared_error(target, p)[0], predicted)
    assert_allclose(by_predicted, found, rtol=1e-6, atol=1e-9)
    assert_allclose(loss, np.mean((target - predicted) ** 2), rtol=1e-12)


def test_sigmoid_never_overflows():
    with np.errstate(all="raise"):
        values = layers.sigmoid(np.array([-1e4, 0.0, 1e4]))
    assert_allclose(values, [0.0, 0.5, 1.0], atol=1e-12)
