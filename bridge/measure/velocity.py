"""Error of the offsets' velocity: whether flesh jiggles as it should, not only where it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.measure.trajectories import Trajectories


@dataclass
class VelocityErrors:
    """Running sums over vertices and frames of d/dt of the offsets in the rest pose."""

    squared_error: float = 0.0
    """Sum of |predicted - true|^2, (m/s)^2."""
    squared_reference: float = 0.0
    """Sum of |true|^2, (m/s)^2."""
    distance: float = 0.0
    """Sum of |predicted - true|, m/s."""
    count: int = 0
    """Vertices, over all pairs of frames."""

    def add(self, predicted: Trajectories, true: Trajectories) -> None:
        """Take in some vertices of one sequence."""
        squared_error = _squared(predicted.velocity_m_s - true.velocity_m_s)
        self.squared_error += float(squared_error.sum(dtype=np.float64))
        self.squared_reference += float(_squared(true.velocity_m_s).sum(dtype=np.float64))
        self.distance += float(np.sqrt(squared_error).sum(dtype=np.float64))
        self.count += squared_error.size

    def merge(self, other: VelocityErrors) -> None:
        """Take in all that `other` has."""
        for name in ("squared_error", "squared_reference", "distance", "count"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def summary(self) -> dict[str, float]:
        """R² (0: no movement at all is predicted), mean and root mean square error, mm/s."""
        count = max(self.count, 1)
        found = 1 - self.squared_error / self.squared_reference if self.squared_reference else None
        return {
            "r2": float("nan") if found is None else found,
            "mean_mm_s": 1e3 * self.distance / count,
            "rms_mm_s": 1e3 * float(np.sqrt(self.squared_error / count)),
            "true_rms_mm_s": 1e3 * float(np.sqrt(self.squared_reference / count)),
        }


def _squared(vectors: NDArray) -> NDArray:
    return np.einsum("tvx,tvx->tv", vectors, vectors)
