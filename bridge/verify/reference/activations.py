"""The nonlinearities that the mesh autoencoder may have, and their slopes."""

from __future__ import annotations

import numpy as np


def activate(name: str, z: np.ndarray, negative_slope: float) -> np.ndarray:
    """`leaky_relu`, `elu`, `tanh` or `relu` of z."""
    if name == "tanh":
        return np.tanh(z)
    below = {
        "leaky_relu": negative_slope * z,
        "elu": np.expm1(np.minimum(z, 0.0)),
        "relu": np.zeros_like(z),
    }
    return np.where(z > 0, z, below[name])


def slope(name: str, z: np.ndarray, negative_slope: float) -> np.ndarray:
    """Derivative of `activate` at z; the one from below where there are two."""
    if name == "tanh":
        return 1 - np.tanh(z) ** 2
    below = {
        "leaky_relu": np.full_like(z, negative_slope),
        "elu": np.exp(np.minimum(z, 0.0)),
        "relu": np.zeros_like(z),
    }
    return np.where(z > 0, 1.0, below[name])
