"""The two losses and their gradients by what was predicted."""

from __future__ import annotations

import numpy as np


def sum_of_distances(
    target: np.ndarray, predicted: np.ndarray, real: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Section 4.3: sum over t of the L2 distance, mean over the batch; and its gradient.

    Parameters
    ----------
    target, predicted : (B, T, D).
    real : (B, T) True for frames that count; all when None.

    Returns
    -------
    The loss, and its gradient (B, T, D), which is 0 where a distance is 0.
    """
    counts = np.ones(target.shape[:2]) if real is None else real.astype(float)
    difference = predicted - target
    distance = np.linalg.norm(difference, axis=-1)
    direction = difference / np.where(distance > 0, distance, 1.0)[..., None]
    clips = len(target)
    return float((counts * distance).sum() / clips), counts[..., None] * direction / clips


def mean_squared_error(target: np.ndarray, predicted: np.ndarray) -> tuple[float, np.ndarray]:
    """The autoencoder's: mean over all numbers of the squared difference; and its gradient."""
    difference = predicted - target
    return float((difference**2).mean()), 2 * difference / difference.size
