"""Motions as smooth functions of time, which any frame rate can be taken of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def swaying(times_s: NDArray, seed: int = 1) -> NDArray[np.float64]:
    """Theta (T, 69) of a body that sways, turns and hops with up to 1.3 beats a second."""
    rng = np.random.default_rng(seed)
    amplitudes = np.r_[rng.normal(0, 0.15, 66), 0.1, 0.12, 0.1]
    rates, phases = rng.uniform(2, 8, 69), rng.uniform(0, 6, 69)
    return rng.normal(0, 0.2, 69) + amplitudes * np.sin(times_s[:, None] * rates + phases)
