"""Errors of skin offsets and meshes, as sums over vertices and frames.

Sums can be added, so sequences are read in pieces, and for a group of thousands of sequences only
the sums are kept.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct

_BIN_M = 1e-5
_BINS = 50_000
# Larger pieces are slower: their arrays do not fit in the cache, and are mapped anew each time.
FRAMES_AT_ONCE = 16
BIN_HZ = 0.5
BANDS_HZ = ((0, 2), (2, 4), (4, 8), (8, 15), (15, 30))
_N_BINS = round(BANDS_HZ[-1][1] / BIN_HZ)
# Below this frequency, offsets follow the pose; soft tissue oscillates above it.
_POSE_BELOW_HZ = 2.0
_HALF_OCTAVE = 2**0.5
S = TypeVar("S", bound="Sums")


@dataclass(frozen=True)
class Offsets:
    """Offsets of P vertices in all T frames of one sequence: errors over time need all of them."""

    total_m: NDArray[np.float32]
    """(T, P, 3) offsets of the mesh from SMPL in the rest pose, metres."""
    fps: float
    static_m: NDArray[np.float32] | None = None
    """(T, P, 3) the part of them that does not move; None where it is not separated."""

    @cached_property
    def moving_m(self) -> NDArray[np.float32]:
        """(T, P, 3) the total offsets without the static part, metres."""
        return self.total_m if self.static_m is None else self.total_m - self.static_m

    @cached_property
    def velocity_m_s(self) -> NDArray[np.float32]:
        """(T - 1, P, 3) change of the moving part from frame to frame, metres a second."""
        return np.diff(self.moving_m, axis=0) * np.float32(self.fps)

    @cached_property
    def cosines_m(self) -> NDArray[np.float32]:
        """(T, P, 3) orthonormal cosine transform of the moving part over time, metres.

        Coefficient k has the frequency k fps / 2T Hz, and squares sum up to those of the offsets.
        Unlike a Fourier transform, it does not see a jump from the last frame to the first.
        """
        return np.asarray(dct(self.moving_m, axis=0, norm="ortho"))


@dataclass
class Sums:
    """Sums over a part of the data; `+=` adds those of another part, field by field."""

    def __iadd__(self: S, other: S) -> S:
        for one in fields(self):
            add = one.metadata.get("add", operator.iadd)
            setattr(self, one.name, add(getattr(self, one.name), getattr(other, one.name)))
        return self

    def summary(self) -> dict[str, Any] | None:
        """Errors for a table, None where there are none."""
        raise NotImplementedError


@dataclass
class SquaredSums(Sums):
    """Sums of vectors, in metres or metres a second, that give an R²."""

    squared_error: float = 0.0
    """Sum of |predicted - true|^2."""
    squared_reference: float = 0.0
    """Sum of |true|^2."""
    distance: float = 0.0
    """Sum of |predicted - true|."""
    count: int = 0
    """Vertices, over all frames."""

    @property
    def r2(self) -> float:
        """1 - sum |predicted - true|^2 / sum |true|^2; NaN without a reference."""
        if not self.squared_reference:
            return float("nan")
        return 1.0 - self.squared_error / self.squared_reference


@dataclass
class ErrorSums(SquaredSums):
    """Errors of positions: of offsets in the rest pose or of posed meshes."""

    largest: float = field(default=0.0, metadata={"add": max})
    """Largest |predicted - true|, metres."""
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_BINS, np.int64))
    """Number of vertices by distance, in bins of 10 micrometres; the last is open-ended."""

    @classmethod
    def of(cls, predicted: ArrayLike, reference: ArrayLike) -> ErrorSums:
        """Sums over frames (T, V, 3), metres."""
        sums = cls()
        sums.add(predicted, reference)
        return sums

    def add(self, predicted: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Add frames (T, V, 3), metres; return the distance of each vertex (T, V)."""
        reference = np.asarray(reference, dtype=np.float64)
        error = np.asarray(predicted, dtype=np.float64) - reference
        distance = np.linalg.norm(error, axis=-1)
        self.squared_error += float(np.square(error).sum())
        self.squared_reference += float(np.square(reference).sum())
        self.distance += float(distance.sum())
        self.largest = max(self.largest, float(distance.max(initial=0.0)))
        self.count += distance.size
        bins = np.minimum(distance / _BIN_M, _BINS - 1).astype(np.int64)
        self.histogram += np.bincount(bins.ravel(), minlength=_BINS)
        return distance

    def summary(self) -> dict[str, float]:
        """Errors in millimetres; `p95_mm` is the 95 % quantile, to 10 micrometres."""
        count = max(self.count, 1)
        reached = np.searchsorted(np.cumsum(self.histogram), 0.95 * self.count)
        return {
            "r2": self.r2,
            "mean_mm": 1e3 * self.distance / count,
            "rms_mm": 1e3 * float(np.sqrt(self.squared_error / count)),
            "p95_mm": 1e3 * float(min((reached + 1) * _BIN_M, self.largest)),
            "max_mm": 1e3 * self.largest,
        }


@dataclass
class VelocitySums(SquaredSums):
    """Errors of the velocity of the moving offsets."""

    @classmethod
    def of(cls, predicted: Offsets, true: Offsets) -> VelocitySums:
        squared, reference = (
            np.einsum("tvx,tvx->tv", one, one)
            for one in (predicted.velocity_m_s - true.velocity_m_s, true.velocity_m_s)
        )
        error, energy, distance = (
            float(one.sum(dtype=np.float64)) for one in (squared, reference, np.sqrt(squared))
        )
        return cls(error, energy, distance, squared.size)

    def summary(self) -> dict[str, float]:
        """R² (0 for offsets that do not move), mean and root mean square error, mm/s."""
        count = max(self.count, 1)
        return {
            "r2": self.r2,
            "mean_mm_s": 1e3 * self.distance / count,
            "rms_mm_s": 1e3 * float(np.sqrt(self.squared_error / count)),
            "true_rms_mm_s": 1e3 * float(np.sqrt(self.squared_reference / count)),
        }


@dataclass
class SpectrumSums(Sums):
    """Squared moving offsets by frequency, in bins of half a hertz."""

    energy: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, _N_BINS)))
    """(3, 60) sums over vertices and frames of the true offsets, the predicted ones and their
    difference, square metres."""
    count: int = 0
    """Vertices, over all frames."""

    @classmethod
    def of(cls, predicted: Offsets, true: Offsets) -> SpectrumSums:
        frames, vertices = true.moving_m.shape[:2]
        bins = frequency_bins(frames, true.fps)
        # The transform is linear, so the difference is that of the coefficients.
        cosines_m = (true.cosines_m, predicted.cosines_m, predicted.cosines_m - true.cosines_m)
        squares = (np.einsum("kvx,kvx->k", one, one) for one in cosines_m)
        energy = [np.bincount(bins, square, minlength=_N_BINS) for square in squares]
        return cls(np.stack(energy, dtype=np.float64), frames * vertices)

    def rms_mm(self) -> NDArray[np.float64]:
        """(3, 60) true, predicted and error: root mean square in each frequency bin, mm."""
        return 1e3 * np.sqrt(self.energy / max(self.count, 1))

    def summary(self) -> dict[str, Any]:
        """`bands`, and `own`: the band of half an octave on either side of `peak_hz`."""
        peak_hz = self.peak_hz()
        around_peak = self._between(peak_hz / _HALF_OCTAVE, peak_hz * _HALF_OCTAVE)
        return {
            "bands": [{"from_hz": low, "to_hz": high} | self._between(low, high)
                      for low, high in BANDS_HZ],
            "own": {"hz": peak_hz} | around_peak,
        }  # fmt: skip

    def peak_hz(self) -> float:
        """The frequency at which the velocity of the true offsets has most energy.

        Energies are smoothed over three bins; low frequencies, which follow the pose, do not count.
        """
        centres_hz = BIN_HZ * (np.arange(_N_BINS) + 0.5)
        energy = np.where(centres_hz > _POSE_BELOW_HZ, centres_hz**2 * self.energy[0], 0.0)
        return float(centres_hz[int(np.argmax(np.convolve(energy, np.ones(3), "same")))])

    def _between(self, low_hz: float, high_hz: float) -> dict[str, float]:
        """Root mean squares, mm, their ratio (predicted over true) and R² of a frequency band."""
        chosen = slice(round(low_hz / BIN_HZ), max(round(high_hz / BIN_HZ), 1))
        true, predicted, error = (float(energy[chosen].sum()) for energy in self.energy)
        count = max(self.count, 1)
        return {
            "true_mm": 1e3 * float(np.sqrt(true / count)),
            "predicted_mm": 1e3 * float(np.sqrt(predicted / count)),
            "ratio": float(np.sqrt(predicted / true)) if true else float("nan"),
            "r2": 1 - error / true if true else float("nan"),
        }


def frequency_bins(frames: int, fps: float) -> NDArray[np.int64]:
    """(T,) index of the frequency bin of each cosine coefficient of `frames` frames."""
    # The small number makes up for rounding, which may put k fps / 2T just below an integer.
    bins = np.arange(frames) * fps / (2 * frames * BIN_HZ) + 1e-9
    return np.minimum(bins.astype(np.int64), _N_BINS - 1)


Errors = dict[str, Sums]
"""Errors of one predictor by measure: `mesh`, `offsets`, `velocity` and `spectrum`; also `moving`
and `static` where the truth separates them."""


def add_errors(total: Errors, part: Errors) -> None:
    """Add errors of a part of the data to those of the whole, in place."""
    for measure, sums in part.items():
        total[measure] = operator.iadd(total.get(measure, type(sums)()), sums)


class GroupErrors:
    """One predictor's errors over the sequences of a group."""

    def __init__(self) -> None:
        self.sums: Errors = {}
        self._squares: dict[str, list[tuple[float, float]]] = {}

    def add(self, errors: Errors) -> None:
        add_errors(self.sums, errors)
        for measure, sums in errors.items():
            if isinstance(sums, SquaredSums):
                pair = sums.squared_error, sums.squared_reference
                self._squares.setdefault(measure, []).append(pair)

    def summary(self) -> dict[str, Any]:
        """The summary of each measure, with `r2_se`, the standard error of its `r2`."""
        summary: dict[str, Any] = {name: sums.summary() for name, sums in self.sums.items()}
        for measure, squares in self._squares.items():
            summary[measure]["r2_se"] = jackknife_r2_se(squares)
        return summary


def jackknife_r2_se(squares: Sequence[tuple[float, float]]) -> float | None:
    """Jackknife standard error of the pooled R² over sequences; None for a single sequence.

    `squares` are each sequence's squared error and squared reference.
    """
    if len(squares) < 2:
        return None
    error, reference = np.array(squares).T.copy()
    without = 1 - (error.sum() - error) / np.maximum(
        reference.sum() - reference, np.finfo(float).tiny
    )
    return float(np.sqrt((len(squares) - 1) * without.var()))


def frame_blocks(frames: slice, size: int = FRAMES_AT_ONCE) -> Iterator[slice]:
    """Cut a range of frames or vertices into pieces of `size`."""
    for start in range(frames.start, frames.stop, size):
        yield slice(start, min(start + size, frames.stop))
