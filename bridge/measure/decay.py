"""Decay after a stop: how fast the swing of flesh dies away once the body stands still.

The swing in a frame is the mean over vertices of |offset - settled offset|, where the settled
offset of a vertex is its mean over the last frames of standing still: gravity leaves flesh hanging,
and what hangs does not swing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.measure.stillness import StillSpan
from bridge.measure.trajectories import Trajectories

_SHARE = 0.2
# A mean over all vertices, most of which lie on bone: less than this is no swing.
_LEAST_M = 5e-5


class SwingSums:
    """Swing after each stop of one sequence, summed up over pieces of the mesh.

    Parameters
    ----------
    spans : when the body stands still.
    """

    def __init__(self, spans: Sequence[StillSpan]) -> None:
        self.stops = [span for span in spans if span.after_motion]
        self._sums_m = [np.zeros(span.stop - span.start) for span in self.stops]
        self._vertices = 0

    def add(self, piece: Trajectories) -> None:
        """Take in some vertices."""
        for span, sums_m in zip(self.stops, self._sums_m, strict=True):
            settled_m = piece.offsets_m[span.settled].mean(axis=0)
            sums_m += np.linalg.norm(piece.offsets_m[span.frames] - settled_m, axis=-1).sum(axis=1)
        self._vertices += piece.offsets_m.shape[1]

    def curves_m(self) -> list[NDArray[np.float64]]:
        """For each stop the swing in its frames, metres."""
        return [sums_m / max(self._vertices, 1) for sums_m in self._sums_m]


@dataclass(frozen=True)
class Decay:
    """One stop."""

    true_s: float
    """From the stop until the true swing stays below a fifth of what it was."""
    predicted_s: float
    """The same of the predicted one."""
    true_mm: float
    """Largest true swing after the stop."""
    predicted_mm: float
    """The same of the predicted one."""


def decays(predicted: SwingSums, true: SwingSums, fps: float) -> list[Decay]:
    """Every stop of one sequence after which the true flesh swings."""
    return [
        Decay(
            fall_time_s(true_m, fps),
            fall_time_s(predicted_m, fps),
            1e3 * float(true_m.max()),
            1e3 * float(predicted_m.max()),
        )
        for predicted_m, true_m in zip(predicted.curves_m(), true.curves_m(), strict=True)
        if true_m.max() >= _LEAST_M
    ]


def fall_time_s(swing_m: ArrayLike, fps: float) -> float:
    """From the first frame until a curve (T,) stays below a fifth of its largest value.

    The last time above counts, so that the zeros of a swing are not taken for its end.
    """
    swing = np.asarray(swing_m)
    above = np.flatnonzero(swing >= _SHARE * swing.max())
    return float(above[-1] + 1) / fps if swing.max() > 0 else 0.0


def summary(found: Sequence[Decay]) -> dict[str, Any] | None:
    """Means over stops and how many there are; None without any."""
    if not found:
        return None
    rows = [asdict(one) for one in found]
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    off_s = float(np.mean([abs(one.predicted_s - one.true_s) for one in found]))
    return {"stops": len(found), "off_s": off_s} | means
