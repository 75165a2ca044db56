"""Tissue that repeats with its motion: predicted lap after lap until nothing of the start is left.

Memory does not grow with the number of laps: those before the last are let go as they come.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.loops import Lap
from bridge.runtime.stepping import FRAMES_AT_ONCE, MotionPredictor, Prediction

SETTLED_M = 1e-4
"""Two laps whose offsets differ nowhere by more are the same."""
LONGEST_S, LEAST_LAPS = 30.0, 6
"""Tissue that has not settled after so long, and so many laps, never does."""
_FPS = 60.0

Piece = NDArray[np.float32]


class LoopedPredictor:
    """Another predictor, applied to a motion that repeats.

    Parameters
    ----------
    predict : the other one.
    lap : the motion that it will be asked for.
    """

    def __init__(self, predict: MotionPredictor, lap: Lap) -> None:
        self._predict, self._lap = predict, lap

    def __call__(self, theta: NDArray, betas: NDArray) -> Prediction:
        """Offsets of a lap theta (T, 69) that follows on itself.

        Raises
        ------
        DsnetError
            If the offsets do not settle within `LONGEST_S` and `LEAST_LAPS`.
        """
        frames = len(theta)
        most = max(int(LONGEST_S * _FPS / frames), LEAST_LAPS)
        # One lap more than is ever given: its last frames are smoothed over those that follow.
        found = self._predict(self._lap.repeated(most + 1), betas)
        pieces, before, differ_m = _between_laps(found.offsets_m, frames), None, np.inf
        for lap in range(most - 1):
            sample = _sampled(pieces, frames)
            if before is not None:
                differ_m = float(np.linalg.norm(sample - before, axis=-1).max())
            if differ_m < SETTLED_M:
                first = (lap + 1) * frames
                latents = None if found.latents is None else found.latents[first : first + frames]
                return Prediction(_next_lap(pieces, frames), latents)
            before = sample
        raise DsnetError(
            f"--loop with offsets that still differ by {1e3 * differ_m:.1f} mm after {most} laps",
            f"laps that agree within {1e3 * SETTLED_M:g} mm",
            "Name another --predictor: one that does not depend on where the body is.",
        )


def _between_laps(pieces: Iterator[Piece], frames: int) -> Iterator[Piece]:
    """The same frames (T', V, 3), in pieces that end where laps do."""
    done = 0
    for piece in pieces:
        ends = range(frames - done % frames, len(piece), frames)
        yield from (part for part in np.split(piece, list(ends)) if len(part))
        done += len(piece)


def _next_lap(pieces: Iterator[Piece], frames: int) -> Iterator[Piece]:
    while frames > 0:
        piece = next(pieces)
        frames -= len(piece)
        yield piece


def _sampled(pieces: Iterator[Piece], frames: int) -> Piece:
    """Of the next lap, at most `FRAMES_AT_ONCE` frames, evenly spread, with its last."""
    every = -(-frames // FRAMES_AT_ONCE)
    kept, start = [], 0
    for piece in _next_lap(pieces, frames):
        places = np.arange(start, start + len(piece))
        kept.append(piece[(frames - 1 - places) % every == 0])
        start += len(piece)
    return np.concatenate(kept)
