"""Sequences of meshes as the robust aligner reads them: some frames, and their accelerations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

# Consecutive frames that are read together for calibration.
_CLIP = 8


@dataclass(frozen=True)
class MeshRecording:
    """One sequence of meshes."""

    read: Callable[[int, int], NDArray[np.float32]]
    """Frames [start, stop) as (n, V, 3) metres."""
    length: int
    """Number of frames."""
    fps: float
    """Frames per second."""

    def meshes(self, start: int, stop: int) -> tuple[Tensor, Tensor]:
        """Frames [start, stop) and their accelerations, both (n, V, 3), m and m/s^2.

        The first and the last frame of a sequence take their neighbour's acceleration, and a
        sequence of fewer than three frames has none.
        """
        if self.length < 3:
            frames = torch.from_numpy(self.read(start, stop))
            return frames, torch.zeros_like(frames)
        # Wide enough to hold three frames, whatever part of the sequence is asked for.
        first = max(min(start - 1, self.length - 3), 0)
        last = min(max(stop + 1, 3), self.length)
        frames = torch.from_numpy(self.read(first, last))
        inner = (frames[2:] - 2 * frames[1:-1] + frames[:-2]) * self.fps**2
        nearest = torch.arange(start, stop).clamp(first + 1, last - 2) - first - 1
        return frames[start - first : stop - first], inner[nearest]


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
