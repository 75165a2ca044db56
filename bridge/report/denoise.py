"""Smooth a path tracer's noise without blurring edges or colours."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

_KERNEL = np.array([0.25, 0.5, 0.25])


def denoise(
    picture: NDArray[np.floating], normals: NDArray[np.floating], depth_m: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Edge-avoiding a-trous filter (Dammertz et al. 2010).

    Parameters
    ----------
    picture : (H, W, 3) sRGB in [0, 1], in which equal differences look about equal.
    normals : (H, W, 3) unit normals, zero where there is no surface.
    depth_m : (H, W) distance from the camera, metres.

    Returns
    -------
    (H, W, 3) picture; pixels of unlike colour, normal or depth have not leaked into one another.
    """
    result = np.asarray(picture, dtype=np.float32)
    guides = np.concatenate([normals / 0.4, depth_m[..., None] / 0.15], axis=-1).astype(np.float32)
    for level, tolerance in enumerate((0.25, 0.16, 0.1, 0.06)):
        result = _smooth(result, guides, step=2**level, tolerance=tolerance)
    return result


def _smooth(
    picture: NDArray[np.float32], guides: NDArray[np.float32], step: int, tolerance: float
) -> NDArray[np.float32]:
    total, weights = np.zeros_like(picture), np.zeros((*picture.shape[:2], 1), np.float32)
    pad = ((step, step), (step, step), (0, 0))
    padded = np.pad(np.concatenate([picture / tolerance, guides], axis=-1), pad, mode="edge")
    centre = padded[step:-step, step:-step]
    height, width = picture.shape[:2]
    for row, column in product(range(3), repeat=2):
        tap = padded[row * step :, column * step :][:height, :width]
        distance = ((tap - centre) ** 2).sum(axis=-1, keepdims=True)
        weight = np.float32(_KERNEL[row] * _KERNEL[column]) * np.exp(-distance)
        total += weight * tap[..., :3] * tolerance
        weights += weight
    return total / weights
