"""Rest: what a body that has stood still for a while is given; a motionless pose is all rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.measure.stillness import StillSpan
from bridge.measure.trajectories import Trajectories


@dataclass
class RestSums:
    """Running sums over the settled frames of still spans."""

    predicted: float = 0.0
    """Sum of |predicted|, metres."""
    true: float = 0.0
    """Sum of |true|, metres."""
    error: float = 0.0
    """Sum of |predicted - true|, metres."""
    count: int = 0
    """Vertices, over all settled frames."""

    def add(self, predicted: Trajectories, true: Trajectories, spans: Sequence[StillSpan]) -> None:
        """Take in some vertices of one sequence."""
        for span in spans:
            found_m, real_m = predicted.offsets_m[span.settled], true.offsets_m[span.settled]
            self.predicted += _total_m(found_m)
            self.true += _total_m(real_m)
            self.error += _total_m(found_m - real_m)
            self.count += real_m.shape[0] * real_m.shape[1]

    def merge(self, other: RestSums) -> None:
        """Take in all that `other` has."""
        for name in ("predicted", "true", "error", "count"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def summary(self) -> dict[str, float] | None:
        """Mean sizes and mean error, millimetres; None if the body never stands still."""
        if not self.count:
            return None
        return {
            f"{name}_mm": 1e3 * getattr(self, name) / self.count
            for name in ("predicted", "true", "error")
        }


def _total_m(offsets_m: NDArray) -> float:
    return float(np.linalg.norm(offsets_m, axis=-1).sum(dtype=np.float64))
