"""Smooth a path tracer's noise without blurring edges or colours."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

_KERNEL = np.array([0.25, 0.5, 0.25])


def denoise_light(
    light: NDArray[np.floating], normals: NDArray[np.floating], depth_m: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Edge-avoiding a-trous filter (Dammertz et al. 2010) of light without surface colour.

    Parameters
    ----------
    light : (H, W, 3) radiance divided by the surface's reflectance, linear.
    normals : (H, W, 3) unit normals, zero where there is no surface.
    depth_m : (H, W) distance from the camera, metres.

    Returns
    -------
    (H, W, 3) light; pixels with other normals or depths have not leaked into one another.
    """
    result = np.asarray(light, dtype=np.float32)
    guides = np.concatenate([normals / 0.25, depth_m[..., None] / 0.1], axis=-1).astype(np.float32)
    for level, tolerance in enumerate((0.6, 0.4, 0.25, 0.15)):
        result = _smooth(result, guides, step=2**level, tolerance=tolerance)
    return result


def _smooth(
    light: NDArray[np.float32], guides: NDArray[np.float32], step: int, tolerance: float
) -> NDArray[np.float32]:
    total, weights = np.zeros_like(light), np.zeros((*light.shape[:2], 1), np.float32)
    pad = ((step, step), (step, step), (0, 0))
    padded = np.pad(np.concatenate([light / tolerance, guides], axis=-1), pad, mode="edge")
    centre = padded[step:-step, step:-step]
    height, width = light.shape[:2]
    for row, column in product(range(3), repeat=2):
        tap = padded[row * step :, column * step :][:height, :width]
        distance = ((tap - centre) ** 2).sum(axis=-1, keepdims=True)
        weight = np.float32(_KERNEL[row] * _KERNEL[column]) * np.exp(-distance)
        total += weight * tap[..., :3] * tolerance
        weights += weight
    return total / weights
