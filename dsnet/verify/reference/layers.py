"""Layers, nonlinearities and losses, forward and backward.

Each `*_backward` takes the gradient of a scalar with respect to the layer's output and returns
the gradients with respect to its input and its parameters. Arrays are batch-first.
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
    """LeakyReLU of z, and its derivative; at 0 that is the negative slope."""
    slope = np.where(z > 0, 1.0, NEGATIVE_SLOPE)
    return slope * z, slope


def sigmoid(z: Array) -> Array:
    """1 / (1 + exp(-z)), without overflow for any z."""
    return 0.5 * (1.0 + np.tanh(0.5 * z))


class LstmStep(NamedTuple):
    """The state after one frame, and the gates that the gradient needs; all (B, H)."""

    hidden: Array
    cell: Array
    input_gate: Array
    forget_gate: Array
    candidate: Array
    output_gate: Array


def lstm(x: Array, kernel: Array, recurrent: Array, bias: Array) -> list[LstmStep]:
    """Run frame by frame over x (B, T, in) from a zero state; gates in the order i, f, c, o."""
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
    """Backpropagation through time: gradients of x, kernel, recurrent kernel and bias."""
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
    """(H,)"""
    variance: Array
    """(H,), biased: divided by the number of frames."""
    mask: Array
    """(B, T, 1) 1 where a frame counts, else 0."""
    divisor: float
    """The divisor of the sums: the number of frames that count, and perhaps an epsilon."""


def moments(x: Array, real: Array | None, count_epsilon: float) -> Moments:
    """Mean and variance of x (B, T, H) over all frames, or over those where `real` (B, T) is true.

    Keras adds `count_epsilon` to the number of frames, but only when there is a mask.
    """
    mask = np.ones((*x.shape[:2], 1)) if real is None else real[..., None].astype(float)
    divisor = mask.sum() + (0.0 if real is None else count_epsilon)
    mean = (mask * x).sum(axis=(0, 1)) / divisor
    variance = (mask * (x - mean) ** 2).sum(axis=(0, 1)) / divisor
    return Moments(mean, variance, mask, divisor)


def batch_norm(
    x: Array, mean: Array, variance: Array, gamma: Array, beta: Array, epsilon: float
) -> Array:
    """Normalise x (..., H) by mean and variance, then scale by gamma and shift by beta."""
    return gamma * (x - mean) / np.sqrt(variance + epsilon) + beta


def batch_norm_backward(
    dy: Array, x: Array, batch: Moments, gamma: Array, epsilon: float
) -> tuple[Array, Array, Array]:
    """Gradients of x, gamma and beta when the batch is normalised by its own statistics.

    Masked frames are normalised too, so they contribute to the gradients of mean and variance. If
    the divisor has an epsilon, deviations do not sum to zero, and the mean affects the variance.
    """
    std = np.sqrt(batch.variance + epsilon)
    deviation = x - batch.mean
    slope = dy * gamma / std
    by_variance = (slope * deviation).sum(axis=(0, 1)) / (-2 * std**2)
    residual = (batch.mask * deviation).sum(axis=(0, 1))
    by_mean = -slope.sum(axis=(0, 1)) - 2 * by_variance * residual / batch.divisor
    through_statistics = batch.mask * (by_mean + 2 * by_variance * deviation) / batch.divisor
    by_gamma = (dy * deviation / std).sum(axis=(0, 1))
    return slope + through_statistics, by_gamma, dy.sum(axis=(0, 1))


def sum_of_distances(
    target: Array, predicted: Array, real: Array | None = None
) -> tuple[float, Array]:
    """The loss of Section 4.3 and its gradient: L2 distances summed over time, mean over the batch.

    Arrays are (B, T, D); only frames where `real` (B, T) is true count. The gradient is 0 where a
    distance is 0.
    """
    counts = np.ones(target.shape[:2]) if real is None else real.astype(float)
    difference = predicted - target
    distance = np.linalg.norm(difference, axis=-1)
    direction = difference / np.where(distance > 0, distance, 1.0)[..., None]
    clips = len(target)
    return float((counts * distance).sum() / clips), counts[..., None] * direction / clips


def mean_squared_error(target: Array, predicted: Array) -> tuple[float, Array]:
    """The autoencoder's loss and its gradient: the mean squared difference of all numbers."""
    difference = predicted - target
    return float((difference**2).mean()), 2 * difference / difference.size
