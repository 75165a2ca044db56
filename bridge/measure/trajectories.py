"""Offsets of some vertices over a whole sequence, and what follows from them alone.

Errors over time need all frames of a vertex, errors of a mesh all vertices of a frame. A piece of
the first kind is computed on here, so that no sequence must fit in memory as a whole; what the true
offsets give is computed once for all predictors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

_VERTICES_AT_ONCE = 512


@dataclass(frozen=True)
class Trajectories:
    """Offsets of P vertices in all T frames of one sequence."""

    offsets_m: NDArray[np.float32]
    """(T, P, 3) in the rest pose, metres."""
    fps: float
    """Frames per second."""

    @cached_property
    def velocity_m_s(self) -> NDArray[np.float32]:
        """(T - 1, P, 3) change from frame to frame, metres a second."""
        return np.diff(self.offsets_m, axis=0) * np.float32(self.fps)

    @cached_property
    def cosines_m(self) -> NDArray[np.float32]:
        """(T, P, 3) orthonormal cosine transform over time, metres.

        Coefficient k turns k fps / 2T times a second, and sums of squares are those of the offsets.
        Unlike Fourier's, it does not take the step from the last frame to the first for movement.
        """
        return np.asarray(dct(self.offsets_m, axis=0, norm="ortho"))


def vertex_pieces(vertex_count: int, size: int = _VERTICES_AT_ONCE) -> Iterator[slice]:
    """Cut a mesh's vertices into pieces whose trajectories fit in memory."""
    for start in range(0, vertex_count, size):
        yield slice(start, min(start + size, vertex_count))
