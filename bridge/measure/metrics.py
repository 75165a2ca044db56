"""Errors of skin offsets, meshes and poses; offsets may be memory-mapped and are read in pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

_BIN_M = 1e-5
_BINS = 50_000
# Larger pieces are slower: their arrays leave the cache, and the system maps memory for each anew.
FRAMES_AT_ONCE = 16


@dataclass
class ErrorSums:
    """Running sums over vertices, from which every error figure of a set of frames follows."""

    squared_error: float = 0.0
    """Sum of |predicted - reference|^2, square metres."""
    squared_reference: float = 0.0
    """Sum of |reference|^2, square metres."""
    distance: float = 0.0
    """Sum of |predicted - reference|, metres."""
    largest: float = 0.0
    """Largest |predicted - reference|, metres."""
    count: int = 0
    """Vertices, over all frames."""
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_BINS, np.int64))
    """Vertices by distance, in bins of 10 micrometres; the last holds all beyond."""

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

    def merge(self, other: ErrorSums) -> None:
        """Take in all frames of `other`."""
        for name in ("squared_error", "squared_reference", "distance", "count"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.largest = max(self.largest, other.largest)
        self.histogram = self.histogram + other.histogram

    @property
    def r2(self) -> float:
        """1 - sum |predicted - reference|^2 / sum |reference|^2: SMPL alone has 0."""
        if not self.squared_reference:
            return float("nan")
        return 1.0 - self.squared_error / self.squared_reference

    def quantile_m(self, share: float) -> float:
        """Distance below which `share` of the vertices stay, to 10 micrometres."""
        reached = np.searchsorted(np.cumsum(self.histogram), share * self.count)
        return float(min((reached + 1) * _BIN_M, self.largest))

    def summary(self) -> dict[str, float]:
        """Figures for a table, errors in millimetres."""
        count = max(self.count, 1)
        return {
            "r2": self.r2,
            "mean_mm": 1e3 * self.distance / count,
            "rms_mm": 1e3 * float(np.sqrt(self.squared_error / count)),
            "p95_mm": 1e3 * self.quantile_m(0.95),
            "max_mm": 1e3 * self.largest,
        }


@dataclass
class FrameErrors:
    """Errors of one predictor on one sequence: their sums, and the mean of each frame."""

    sums: ErrorSums = field(default_factory=ErrorSums)
    _frames_m: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, predicted: ArrayLike, reference: ArrayLike) -> None:
        """Take in frames (T, V, 3), metres."""
        self._frames_m.append(self.sums.add(predicted, reference).mean(axis=1))

    def frames_m(self) -> NDArray[np.float32]:
        """(T,) mean error of each frame."""
        return np.concatenate(self._frames_m).astype(np.float32)

    def frame_summary_mm(self) -> dict[str, float]:
        """Mean, least and largest of the frames' errors."""
        frames_mm = 1e3 * self.frames_m().astype(np.float64)
        return {key: float(getattr(frames_mm, key)()) for key in ("mean", "min", "max")}


class SquaredSums(Protocol):
    """What an R2 follows from."""

    squared_error: float
    squared_reference: float


def jackknife_r2_se(parts: Sequence[SquaredSums]) -> float | None:
    """Standard error of the pooled R2 over sequences, by leaving each out; None for one alone."""
    if len(parts) < 2:
        return None
    error = np.array([part.squared_error for part in parts])
    reference = np.array([part.squared_reference for part in parts])
    without = 1 - (error.sum() - error) / np.maximum(
        reference.sum() - reference, np.finfo(float).tiny
    )
    return float(np.sqrt((len(parts) - 1) * without.var()))


def frame_blocks(frames: slice, size: int = FRAMES_AT_ONCE) -> Iterator[slice]:
    """Cut a range of frames into pieces that fit in memory."""
    for start in range(frames.start, frames.stop, size):
        yield slice(start, min(start + size, frames.stop))


def mean_offset_m(offsets_m: NDArray, frames: slice) -> NDArray[np.float64]:
    """Mean (V, 3) over a range of frames of (F, V, 3)."""
    total = np.zeros(offsets_m.shape[1:])
    for block in frame_blocks(frames):
        total += offsets_m[block].sum(axis=0, dtype=np.float64)
    return total / (frames.stop - frames.start)


def rotation_error_deg(pose: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
    """Angle (...,) between rotations given as axis-angle vectors (..., 3), degrees."""
    pose, reference = np.asarray(pose, np.float64), np.asarray(reference, np.float64)
    difference = Rotation.from_rotvec(pose.reshape(-1, 3)).inv() * Rotation.from_rotvec(
        reference.reshape(-1, 3)
    )
    return np.degrees(difference.magnitude()).reshape(pose.shape[:-1])
