"""Sequences of meshes as the robust aligner reads them: some frames, and how they move."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

# Consecutive frames that are read together for calibration.
_CLIP = 8
# An acceleration looks two frames to either side, its change one more.
_MARGIN = 3
_DIFFERENCES = 4
# Of the absolute value, at unit variance.
_MEDIAN_OF_NORMAL = 0.6745


@dataclass(frozen=True)
class MeshRecording:
    """One sequence of meshes."""

    read: Callable[[int, int], NDArray[np.float32]]
    """Frames [start, stop) as (n, V, 3) metres."""
    length: int
    """Number of frames."""
    fps: float
    """Frames per second."""

    def moving(
        self, start: int, stop: int, take: Callable[[Tensor], Tensor]
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Frames [start, stop): meshes (n, V, 3), m, and how their sample moves.

        Parameters
        ----------
        take : from meshes (n, V, 3) to the sample (n, 3, N).

        Returns
        -------
        meshes (n, V, 3), metres; of the sample (n, 3, N) places, accelerations and their rate of
        change, m, m/s^2 and m/s^3.
        """
        first, last = max(start - _MARGIN, 0), min(stop + _MARGIN, self.length)
        frames = torch.from_numpy(self.read(first, last))
        vertices = take(frames)
        acceleration = accelerations(vertices, self.fps)
        rows = torch.arange(start, stop) - first
        after, before = (rows + 1).clamp(max=len(frames) - 1), (rows - 1).clamp(min=0)
        jerk = (acceleration[after] - acceleration[before]) * (self.fps / 2)
        own = slice(start - first, stop - first)
        return frames[own], vertices[own], acceleration[own], jerk


def accelerations(frames: Tensor, fps: float) -> Tensor:
    """Second differences (n, ...) of n frames, per s^2, over two frames to either side.

    (S_t+2 - 2 S_t + S_t-2) / 4 dt^2 has a quarter of the noise of the difference over one frame,
    and flesh hardly moves faster. The frames next to the ends take one frame to either side, the
    ends their neighbour's; fewer than three frames have no acceleration.
    """
    result = torch.zeros_like(frames)
    for step in (1, 2):
        if len(frames) > 2 * step:
            middle = frames[step:-step]
            inner = (frames[2 * step :] - 2 * middle + frames[: -2 * step]) * (fps / step) ** 2
            result[step:-step] = inner
    result[0], result[-1] = result[1:2].sum(0), result[-2:-1].sum(0)
    return result


def noise_variance(frames: Tensor, around: Tensor) -> float:
    """Variance, m^2, of what differs from frame to frame in each coordinate of each vertex.

    Fourth differences, whose noise has 70 times its variance, less their mean over the skin
    around, in which smooth motion is and noise is not. The median forgives what is left of it.

    Parameters
    ----------
    frames : (n, 3, N) consecutive frames; fewer than five tell nothing.
    around : (N, N) weights of that mean.
    """
    if len(frames) < _DIFFERENCES + 1:
        return 0.0
    rough = frames.diff(n=_DIFFERENCES, dim=0)
    rough = rough - rough @ around
    return float((rough.abs().median() / _MEDIAN_OF_NORMAL) ** 2) / math.comb(8, 4)


def shared_noise(variance_m2: float, fps: float) -> float:
    """m^2/s^2: expected -(noise . acceleration) of one frame of a vertex, three coordinates.

    The acceleration holds -2 S_t / (2 dt)^2, and so the frame's own noise: a regression would
    take that for softness, of bone too.
    """
    return 3 * 2 * (fps / 2) ** 2 * variance_m2


@dataclass(frozen=True)
class FrameWindow:
    """Consecutive frames of one sequence."""

    row: int
    """Index of the sequence."""
    start: int
    """First frame, counted within the sequence."""
    stop: int
    """One past the last."""


def windows(lengths: Sequence[int], frames: int) -> list[FrameWindow]:
    """All sequences cut into windows of `frames`, one sequence after the other."""
    return [
        FrameWindow(row, start, min(start + frames, length))
        for row, length in enumerate(lengths)
        for start in range(0, length, frames)
    ]


def spread_clips(
    recordings: Sequence[MeshRecording], frames: int
) -> Iterator[tuple[MeshRecording, int, int]]:
    """Short clips (recording, start, stop) evenly spread over all frames, `frames` in all."""
    ends = np.cumsum([recording.length for recording in recordings])
    count = max(min(frames, int(ends[-1])) // _CLIP, 1)
    for centre in (np.arange(count) + 0.5) * ends[-1] / count:
        row = int(np.searchsorted(ends, centre, side="right"))
        recording = recordings[row]
        within = int(centre) - int(ends[row] - recording.length)
        start = min(max(within - _CLIP // 2, 0), max(recording.length - _CLIP, 0))
        yield recording, start, min(start + _CLIP, recording.length)
