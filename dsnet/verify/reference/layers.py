"""The layers that learn, nonlinearities and losses, forwards and backwards.

Each `*_backward` takes the gradient of a scalar by the layer's output and returns the gradients
by its input and its parameters. Arrays are batch-first; leading axes are any.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bridge.paper import NEGATIVE_SLOPE

Array = np.ndarray
Arrays = dict[str, np.ndarray]


def dense(x: Array, kernel: Array, bias: Array) -> Array:
    """x (..., in), kernel (in, out), bias (out,) -> (..., out)."""
    return x @ kernel + bias


def dense_backward(dy: Array, x: Array, kernel: Array) -> tuple[Array, Array, Array]:
    rows, slopes = x.reshape(-1, x.shape[-1]), dy.reshape(-1, dy.shape[-1])
    return dy @ kernel.T, rows.T @ slopes, slopes.sum(axis=0)


def leaky_relu(z: Array) -> tuple[Array, Array]:
    """LeakyReLU of z, and the slope there: the one from below at 0."""
    slope = np.where(z > 0, 1.0, NEGATIVE_SLOPE)
    return slope * z, slope


def sigmoid(z: Array) -> Array:
    """1 / (1 + exp(-z)), without overflow for any z."""
    return 0.5 * (1.0 + np.tanh(0.5 * z))


class LstmStep(NamedTuple):
    """What one frame leaves behind: the new state, and what its gradient needs; all (B, H)."""

    hidden: Array
    cell: Array
    input_gate: Array
    forget_gate: Array
    candidate: Array
    output_gate: Array


def lstm(x: Array, kernel: Array, recurrent: Array, bias: Array) -> list[LstmStep]:
    """All frames of x (B, T, in) from a state of zeros, one by one; gates in the order i, f, c, o.

    Nothing but hidden and cell state passes from one frame to the next.
    """
    hidden = cell = np.zeros((len(x), len(recurrent)))
    steps: list[LstmStep] = []
    for frame in x.swapaxes(0, 1):
        i, f, c, o = np.split(frame @ kernel + hidden @ recurrent + bias, 4, axis=-1)
        i, f, c, o = sigmoid(i), sigmoid(f), np.tanh(c), sigmoid(o)
        cell = f * cell + i * c
        hidden = o * np.tanh(cell)
        steps.append(LstmStep(hidden, cell, i, f, c, o))
    return steps


def lstm_backward(
    dy: Array, x: Array, steps: list[LstmStep], kernel: Array, recurrent: Array
) -> tuple[Array, Array, Array, Array]:
    """Back through time: gradients by x, kernel, recurrent kernel and bias."""
    zeros = np.zeros_like(steps[0].hidden)
    by_x, by_kernel = np.zeros_like(x), np.zeros_like(kernel)
    by_recurrent, by_bias = np.zeros_like(recurrent), np.zeros(kernel.shape[1])
    dhidden, dcell = zeros, zeros
    for t in reversed(range(len(steps))):
        step = steps[t]
        past_hidden, past_cell = (steps[t - 1].hidden, steps[t - 1].cell) if t else (zeros, zeros)
        dhidden = dhidden + dy[:, t]
        squashed = np.tanh(step.cell)
        dcell = dcell + dhidden * step.output_gate * (1 - squashed**2)
        dgates = [
            dcell * step.candidate * step.input_gate * (1 - step.input_gate),
            dcell * past_cell * step.forget_gate * (1 - step.forget_gate),
            dcell * step.input_gate * (1 - step.candidate**2),
            dhidden * squashed * step.output_gate * (1 - step.output_gate),
        ]
        dz = np.concatenate(dgates, axis=-1)
        by_x[:, t] = dz @ kernel.T
        by_kernel += x[:, t].T @ dz
        by_recurrent += past_hidden.T @ dz
        by_bias += dz.sum(axis=0)
        dhidden = dz @ recurrent.T
        dcell = dcell * step.forget_gate
    return by_x, by_kernel, by_recurrent, by_bias


class Moments(NamedTuple):
    """Statistics of a batch over the frames that count."""

    mean: Array
    """(H,), like the variance, which is biased: divided by the count."""
    variance: Array
    counted: Array
    """(B, T, 1) 1 where a frame counts."""
    divisor: float
    """What the sums were divided by."""


def moments(x: Array, real: Array | None, count_epsilon: float) -> Moments:
    """Mean and variance of x (B, T, H); of frames where `real` (B, T), when it is given.

    Keras adds `count_epsilon` to the number of frames, but only when there is a mask.
    """
    counted = np.ones((*x.shape[:2], 1)) if real is None else real[..., None].astype(float)
    divisor = counted.sum() + (0.0 if real is None else count_epsilon)
    mean = (counted * x).sum(axis=(0, 1)) / divisor
    variance = (counted * (x - mean) ** 2).sum(axis=(0, 1)) / divisor
    return Moments(mean, variance, counted, divisor)


def batch_norm(
    x: Array, mean: Array, variance: Array, gamma: Array, beta: Array, epsilon: float
) -> Array:
    """x (..., H) brought to zero mean and unit variance, then to gamma and beta."""
    return gamma * (x - mean) / np.sqrt(variance + epsilon) + beta


def batch_norm_backward(
    dy: Array, x: Array, batch: Moments, gamma: Array, epsilon: float
) -> tuple[Array, Array, Array]:
    """Gradients by x, gamma and beta of a pass that used the statistics of the batch itself.

    Frames that do not count are normalised too, so they have a part in the gradient by the
    statistics; and the counted deviations do not quite sum to zero when the divisor is not the
    count, so the mean has a part in the variance.
    """
    spread = np.sqrt(batch.variance + epsilon)
    deviation = x - batch.mean
    slope = dy * gamma / spread
    by_variance = (slope * deviation).sum(axis=(0, 1)) / (-2 * spread**2)
    left_over = (batch.counted * deviation).sum(axis=(0, 1))
    by_mean = -slope.sum(axis=(0, 1)) - 2 * by_variance * left_over / batch.divisor
    through_statistics = batch.counted * (by_mean + 2 * by_variance * deviation) / batch.divisor
    by_gamma = (dy * deviation / spread).sum(axis=(0, 1))
    return slope + through_statistics, by_gamma, dy.sum(axis=(0, 1))


def sum_of_distances(
    target: Array, predicted: Array, real: Array | None = None
) -> tuple[float, Array]:
    """Section 4.3: sum over t of the L2 distance, mean over the batch; and its gradient.

    Of (B, T, D), over the frames where `real` (B, T). The gradient is 0 where a distance is 0.
    """
    counts = np.ones(target.shape[:2]) if real is None else real.astype(float)
    difference = predicted - target
    distance = np.linalg.norm(difference, axis=-1)
    direction = difference / np.where(distance > 0, distance, 1.0)[..., None]
    clips = len(target)
    return float((counts * distance).sum() / clips), counts[..., None] * direction / clips


def mean_squared_error(target: Array, predicted: Array) -> tuple[float, Array]:
    """The autoencoder's: mean over all numbers of the squared difference; and its gradient."""
    difference = predicted - target
    return float((difference**2).mean()), 2 * difference / difference.size
