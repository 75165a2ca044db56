"""Spectrum of the offsets: how much flesh moves how fast, predicted and true."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.measure.trajectories import Trajectories

STEP_HZ = 0.5
BANDS_HZ = ((0, 2), (2, 4), (4, 8), (8, 15), (15, 30))
_BINS = round(BANDS_HZ[-1][1] / STEP_HZ)
# Below this, offsets follow the pose; flesh swings at higher frequencies.
_POSES_BELOW_HZ = 2.0
_HALF_OCTAVE = 2**0.5


def _no_energy() -> NDArray[np.float64]:
    return np.zeros(_BINS)


@dataclass
class SpectrumSums:
    """Running sums of squared offsets by frequency, in steps of half a hertz."""

    true: NDArray[np.float64] = field(default_factory=_no_energy)
    """(60,) of the true offsets, square metres, over vertices and frames."""
    predicted: NDArray[np.float64] = field(default_factory=_no_energy)
    """(60,) of the predicted ones."""
    error: NDArray[np.float64] = field(default_factory=_no_energy)
    """(60,) of their difference."""
    count: int = 0
    """Vertices, over all frames."""

    def add(self, predicted: Trajectories, true: Trajectories) -> None:
        """Take in some vertices of one sequence."""
        frames, vertices = true.offsets_m.shape[:2]
        bins = bins_of(frames, true.fps)
        # The transform is linear: the difference need not be transformed too.
        for sums, cosines_m in (
            (self.true, true.cosines_m),
            (self.predicted, predicted.cosines_m),
            (self.error, predicted.cosines_m - true.cosines_m),
        ):
            energy = np.einsum("kvx,kvx->k", cosines_m, cosines_m).astype(np.float64)
            sums += np.bincount(bins, energy, minlength=_BINS)
        self.count += frames * vertices

    def merge(self, other: SpectrumSums) -> None:
        """Take in all that `other` has."""
        for name in ("true", "predicted", "error", "count"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def rms_mm(self) -> NDArray[np.float64]:
        """(3, 60) true, predicted and error: root mean square of each step of frequency, mm."""
        energy = np.stack([self.true, self.predicted, self.error])
        return 1e3 * np.sqrt(energy / max(self.count, 1))

    def summary(self) -> dict[str, Any]:
        """`bands`, and `own`: half an octave either way of the tissue's own frequency."""
        own_hz = self.own_hz()
        own = self._between(own_hz / _HALF_OCTAVE, own_hz * _HALF_OCTAVE)
        return {
            "bands": [{"from_hz": low, "to_hz": high} | self._between(low, high)
                      for low, high in BANDS_HZ],
            "own": {"hz": own_hz} | own,
        }  # fmt: skip

    def own_hz(self) -> float:
        """Where the true offsets move fastest: the frequency with most of their velocity's energy.

        Poses change more slowly and are left out; the mean of three neighbours is compared.
        """
        middles_hz = STEP_HZ * (np.arange(_BINS) + 0.5)
        speed = np.where(middles_hz > _POSES_BELOW_HZ, middles_hz**2 * self.true, 0.0)
        return float(middles_hz[int(np.argmax(np.convolve(speed, np.ones(3), "same")))])

    def _between(self, low_hz: float, high_hz: float) -> dict[str, float]:
        """Root mean squares, mm; predicted over true; R² of what lies between two frequencies."""
        chosen = slice(round(low_hz / STEP_HZ), max(round(high_hz / STEP_HZ), 1))
        true, predicted, error = (
            float(sums[chosen].sum()) for sums in (self.true, self.predicted, self.error)
        )
        count = max(self.count, 1)
        return {
            "true_mm": 1e3 * float(np.sqrt(true / count)),
            "predicted_mm": 1e3 * float(np.sqrt(predicted / count)),
            "ratio": float(np.sqrt(predicted / true)) if true else float("nan"),
            "r2": 1 - error / true if true else float("nan"),
        }


def bins_of(frames: int, fps: float) -> NDArray[np.int64]:
    """(T,) step of frequency in which each coefficient of `frames` frames lies."""
    # A hair more than nothing: k fps / 2T may fall just below the whole number that it is.
    steps = np.arange(frames) * fps / (2 * frames * STEP_HZ) + 1e-9
    return np.minimum(steps.astype(np.int64), _BINS - 1)
