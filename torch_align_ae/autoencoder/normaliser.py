"""Ways to take 'normalized ... within the range of [-1, 1]' (Section 5).

Offsets are a millimetre on average and several centimetres at the extreme, so
the choice decides whether anything is left to learn from:

`global_maximum`
    Divide by the largest coordinate of all: the plainest way to take the words.
`vertex_maximum`
    Remove the mean, divide each vertex's coordinates by their own largest one.
`standard`
    Remove the mean, divide by one standard deviation; values leave [-1, 1].
    The mean squared error then is the offsets' own, up to one constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.motion.splits import chunks

NormalisationName = Literal["global_maximum", "vertex_maximum", "standard"]
_SMALLEST_SCALE_M = 1e-4
"""Vertices that hardly move would otherwise be blown up to pure measurement noise."""


@dataclass(frozen=True)
class Normaliser:
    """An affine map per coordinate: (offset - mean) / scale, and back."""

    mean_m: Tensor
    """(V, 3), metres."""
    scale_m: Tensor
    """(V, 3), metres, positive."""

    def normalise(self, offsets_m: Tensor) -> Tensor:
        """Metres (B, V, 3) to the network's numbers."""
        return (offsets_m - self.mean_m) / self.scale_m

    def denormalise(self, values: Tensor) -> Tensor:
        """The network's numbers (B, V, 3) to metres."""
        return values * self.scale_m + self.mean_m

    def to(self, device: torch.device) -> Normaliser:
        """The same map on another device."""
        return Normaliser(self.mean_m.to(device), self.scale_m.to(device))


@dataclass(frozen=True)
class OffsetStatistics:
    """What one pass over the training frames finds; float64."""

    mean_m: NDArray[np.float64]
    """(V, 3)."""
    smallest_m: NDArray[np.float64]
    """(V, 3)."""
    largest_m: NDArray[np.float64]
    """(V, 3)."""
    deviation_m: float
    """Root mean square of (offset - mean) over all coordinates and frames."""


def offset_statistics(
    offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> OffsetStatistics:
    """Stream the named frames of (F, V, 3) offsets once."""
    total = np.zeros(offsets_m.shape[1:])
    smallest, largest = np.full_like(total, np.inf), np.full_like(total, -np.inf)
    squares = 0.0
    for part in chunks(offsets_m, frames):
        total += part.sum(axis=0, dtype=np.float64)
        squares += float(np.square(part, dtype=np.float64).sum())
        np.minimum(smallest, part.min(axis=0), out=smallest)
        np.maximum(largest, part.max(axis=0), out=largest)
    mean = total / len(frames)
    variance = squares / (len(frames) * total.size) - np.square(mean).mean()
    return OffsetStatistics(mean, smallest, largest, float(np.sqrt(max(variance, 0.0))))


def fit_normaliser(
    name: NormalisationName, offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> Normaliser:
    """Fit one normalisation to the named (training) frames of (F, V, 3) offsets."""
    found = offset_statistics(offsets_m, frames)
    zero, one = np.zeros_like(found.mean_m), np.ones_like(found.mean_m)
    if name == "global_maximum":
        extreme = max(np.abs(found.smallest_m).max(), np.abs(found.largest_m).max())
        return _normaliser(zero, one * extreme)
    if name == "vertex_maximum":
        reach = np.maximum(found.largest_m - found.mean_m, found.mean_m - found.smallest_m)
        return _normaliser(found.mean_m, reach)
    return _normaliser(found.mean_m, one * found.deviation_m)


def _normaliser(mean_m: NDArray[np.float64], scale_m: NDArray[np.float64]) -> Normaliser:
    scale_m = np.maximum(scale_m, _SMALLEST_SCALE_M)
    return Normaliser(
        torch.from_numpy(mean_m.astype(np.float32)), torch.from_numpy(scale_m.astype(np.float32))
    )
