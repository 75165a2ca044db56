"""Errors of skin offsets, meshes and poses, as sums over vertices and frames.

Sums of parts add up to those of the whole, so sequences are read in pieces, and of a group of
thousands of sequences only the sums are kept.
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
# Larger pieces are slower: their arrays leave the cache, and the system maps memory for each anew.
FRAMES_AT_ONCE = 16
STEP_HZ = 0.5
BANDS_HZ = ((0, 2), (2, 4), (4, 8), (8, 15), (15, 30))
_STEPS = round(BANDS_HZ[-1][1] / STEP_HZ)
# Below this, offsets follow the pose; flesh swings at higher frequencies.
_POSES_BELOW_HZ = 2.0
_HALF_OCTAVE = 2**0.5
Own = TypeVar("Own", bound="Sums")


@dataclass(frozen=True)
class Offsets:
    """Offsets of P vertices in all T frames of one sequence: errors over time need all of them."""

    total_m: NDArray[np.float32]
    """(T, P, 3) what a mesh has over SMPL in the rest pose, metres."""
    fps: float
    static_m: NDArray[np.float32] | None = None
    """(T, P, 3) the part of it that does not swing; None where nothing is known apart."""

    @cached_property
    def moving_m(self) -> NDArray[np.float32]:
        """(T, P, 3) what swings: all of it, or all but the static part."""
        return self.total_m if self.static_m is None else self.total_m - self.static_m

    @cached_property
    def velocity_m_s(self) -> NDArray[np.float32]:
        """(T - 1, P, 3) change of the moving part from frame to frame, metres a second."""
        return np.diff(self.moving_m, axis=0) * np.float32(self.fps)

    @cached_property
    def cosines_m(self) -> NDArray[np.float32]:
        """(T, P, 3) orthonormal cosine transform of the moving part over time, metres.

        Coefficient k turns k fps / 2T times a second, and sums of squares are those of the offsets.
        Unlike Fourier's, it does not take the step from the last frame to the first for movement.
        """
        return np.asarray(dct(self.moving_m, axis=0, norm="ortho"))


@dataclass
class Sums:
    """Sums over a part of the data; `+=` takes in another part's, field by field."""

    def __iadd__(self: Own, other: Own) -> Own:
        for one in fields(self):
            add = one.metadata.get("add", operator.iadd)
            setattr(self, one.name, add(getattr(self, one.name), getattr(other, one.name)))
        return self

    def summary(self) -> dict[str, Any] | None:
        """Figures for a table, None where there are none."""
        raise NotImplementedError


@dataclass
class SquaredSums(Sums):
    """Sums from which an R² follows, of vectors in metres or metres a second."""

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
        """1 - sum |predicted - true|^2 / sum |true|^2: of no offsets, 0."""
        if not self.squared_reference:
            return float("nan")
        return 1.0 - self.squared_error / self.squared_reference


@dataclass
class ErrorSums(SquaredSums):
    """Errors of places, of offsets in the rest pose or of posed meshes."""

    largest: float = field(default=0.0, metadata={"add": max})
    """Largest |predicted - true|, metres."""
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_BINS, np.int64))
    """Vertices by distance, in bins of 10 micrometres; the last holds all beyond."""

    @classmethod
    def of(cls, predicted: ArrayLike, reference: ArrayLike) -> ErrorSums:
        """Of frames (T, V, 3), metres."""
        sums = cls()
        sums.add(predicted, reference)
        return sums

    def add(self, predicted: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Take in frames (T, V, 3), metres; return the distance of each vertex (T, V)."""
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
        """Errors in millimetres; 95 % of the vertices stay below `p95_mm`, to 10 micrometres."""
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
    """Errors of d/dt of the offsets: whether flesh jiggles as it should, not only where it is."""

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
        """R² (0: no movement at all is predicted), mean and root mean square error, mm/s."""
        count = max(self.count, 1)
        return {
            "r2": self.r2,
            "mean_mm_s": 1e3 * self.distance / count,
            "rms_mm_s": 1e3 * float(np.sqrt(self.squared_error / count)),
            "true_rms_mm_s": 1e3 * float(np.sqrt(self.squared_reference / count)),
        }


@dataclass
class SpectrumSums(Sums):
    """Squared offsets by frequency, in steps of half a hertz: how much flesh moves how fast."""

    energy: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, _STEPS)))
    """(3, 60) of the true offsets, of the predicted ones and of their difference, square metres,
    over vertices and frames."""
    count: int = 0
    """Vertices, over all frames."""

    @classmethod
    def of(cls, predicted: Offsets, true: Offsets) -> SpectrumSums:
        frames, vertices = true.moving_m.shape[:2]
        steps = frequency_steps(frames, true.fps)
        # The transform is linear: the difference need not be transformed too.
        cosines_m = (true.cosines_m, predicted.cosines_m, predicted.cosines_m - true.cosines_m)
        squares = (np.einsum("kvx,kvx->k", one, one) for one in cosines_m)
        energy = [np.bincount(steps, square, minlength=_STEPS) for square in squares]
        return cls(np.stack(energy, dtype=np.float64), frames * vertices)

    def rms_mm(self) -> NDArray[np.float64]:
        """(3, 60) true, predicted and error: root mean square of each step of frequency, mm."""
        return 1e3 * np.sqrt(self.energy / max(self.count, 1))

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
        middles_hz = STEP_HZ * (np.arange(_STEPS) + 0.5)
        speed = np.where(middles_hz > _POSES_BELOW_HZ, middles_hz**2 * self.energy[0], 0.0)
        return float(middles_hz[int(np.argmax(np.convolve(speed, np.ones(3), "same")))])

    def _between(self, low_hz: float, high_hz: float) -> dict[str, float]:
        """Root mean squares, mm; predicted over true; R² of what lies between two frequencies."""
        chosen = slice(round(low_hz / STEP_HZ), max(round(high_hz / STEP_HZ), 1))
        true, predicted, error = (float(energy[chosen].sum()) for energy in self.energy)
        count = max(self.count, 1)
        return {
            "true_mm": 1e3 * float(np.sqrt(true / count)),
            "predicted_mm": 1e3 * float(np.sqrt(predicted / count)),
            "ratio": float(np.sqrt(predicted / true)) if true else float("nan"),
            "r2": 1 - error / true if true else float("nan"),
        }


def frequency_steps(frames: int, fps: float) -> NDArray[np.int64]:
    """(T,) step of frequency in which each coefficient of `frames` frames lies."""
    # A hair more than nothing: k fps / 2T may fall just below the whole number that it is.
    steps = np.arange(frames) * fps / (2 * frames * STEP_HZ) + 1e-9
    return np.minimum(steps.astype(np.int64), _STEPS - 1)


Errors = dict[str, Sums]
"""Of one predictor, by what is compared: `mesh`, `offsets` and, where the truth tells them apart,
`moving` and `static`; of what moves `velocity` and `spectrum`."""


def add_errors(total: Errors, part: Errors) -> None:
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
        """The summary of each measure; what has an `r2` has `r2_se`, its spread over sequences."""
        found: dict[str, Any] = {name: sums.summary() for name, sums in self.sums.items()}
        for measure, squares in self._squares.items():
            found[measure]["r2_se"] = jackknife_r2_se(squares)
        return found


def jackknife_r2_se(squares: Sequence[tuple[float, float]]) -> float | None:
    """Standard error of the pooled R², from each sequence's squared error and squared reference,
    by leaving each out; None for one alone."""
    if len(squares) < 2:
        return None
    error, reference = np.array(squares).T.copy()
    without = 1 - (error.sum() - error) / np.maximum(
        reference.sum() - reference, np.finfo(float).tiny
    )
    return float(np.sqrt((len(squares) - 1) * without.var()))


def frame_blocks(frames: slice, size: int = FRAMES_AT_ONCE) -> Iterator[slice]:
    """Cut a range of frames or vertices into pieces that fit in memory."""
    for start in range(frames.start, frames.stop, size):
        yield slice(start, min(start + size, frames.stop))
