"""A motion whose joints and root turn and travel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def lively(frames: int = 40, seed: int = 0) -> NDArray:
    """A motion whose joints and root turn and travel smoothly."""
    rng = np.random.default_rng(seed)
    phases, rates = rng.uniform(0, 2 * np.pi, (1, 69)), rng.uniform(0.05, 0.2, (1, 69))
    return 0.7 * np.sin(rates * np.arange(frames)[:, None] + phases)
