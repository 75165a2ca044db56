"""DSNet in float64 NumPy, one frame and one gate at a time: slow, obvious, independent."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray


def sigmoid(z: NDArray) -> NDArray:
    return 1.0 / (1.0 + np.exp(-z))


def dsnet(weights: Mapping[str, NDArray], motion: NDArray) -> NDArray:
    """Inputs (T, 79) to latents (T, 100) with the running statistics."""
    w = {name: array.astype(np.float64) for name, array in weights.items()}
    kernels = np.split(w["lstm/kernel"], 4, axis=1)
    recurrent = np.split(w["lstm/recurrent_kernel"], 4, axis=1)
    biases = np.split(w["lstm/bias"], 4)
    hidden = cell = np.zeros(60)
    latents = []
    for frame in motion.astype(np.float64):
        x = frame @ w["fc_enc_1/kernel"] + w["fc_enc_1/bias"]
        x = np.tanh(x @ w["fc_enc_2/kernel"] + w["fc_enc_2/bias"])
        i, f, c, o = (
            x @ k + hidden @ r + b for k, r, b in zip(kernels, recurrent, biases, strict=True)
        )
        cell = sigmoid(f) * cell + sigmoid(i) * np.tanh(c)
        hidden = sigmoid(o) * np.tanh(cell)
        spread = np.sqrt(w["batch_norm/moving_variance"] + 1e-3)
        normalised = (hidden - w["batch_norm/moving_mean"]) / spread
        normalised = normalised * w["batch_norm/gamma"] + w["batch_norm/beta"]
        latents.append(normalised @ w["fc_enc_3/kernel"] + w["fc_enc_3/bias"])
    return np.array(latents)
