"""Times of the model's ticks, 60 a second, relative to a stream's frames of any rate."""

from __future__ import annotations

import math
from fractions import Fraction

from bridge.errors import DsnetError
from bridge.paper import FPS

_RATES_HZ = (10.0, 1000.0)
"""Lowest and highest frame rate: below, motion between frames would have to be guessed."""
_LARGEST_DENOMINATOR = 1001
"""Rates of television have this denominator, such as 30000 / 1001."""


class FrameClock:
    """Converts between frames of any rate and ticks, 60 a second, at which models compute.

    It counts in exact fractions, so errors do not add up. Frame 0 is at tick 0.
    """

    def __init__(self, fps: float) -> None:
        try:
            self.fps = float(fps)  # may be an array, as in motion files
        except (TypeError, ValueError):
            self.fps = math.nan
        if not _RATES_HZ[0] <= self.fps <= _RATES_HZ[1]:  # nan is not
            raise DsnetError(
                f"fps={fps}", f"{_RATES_HZ[0]:g} to {_RATES_HZ[1]:g}", "Pass frames per second."
            )
        per_tick = Fraction(self.fps).limit_denominator(_LARGEST_DENOMINATOR)
        self._per_frame = Fraction(int(FPS)) / per_tick

    def latency_frames(self, look_ahead: int) -> int:
        """Latency in frames if the result of a tick is known `look_ahead` ticks later.

        The newest tick may be up to almost one tick older than the newest frame.
        """
        return math.ceil(
            (look_ahead + 1 - Fraction(1, self._per_frame.denominator)) / self._per_frame
        )

    def ticks(self, frame: int) -> range:
        """Ticks after the previous frame, up to this frame."""
        before, now = (math.floor(f * self._per_frame) for f in (frame - 1, frame))
        return range(before + 1, now + 1) if frame else range(1)

    def fraction(self, tick: int, frame: int) -> float:
        """Position of a tick of `ticks(frame)` between the previous frame, 0, and this one, 1."""
        return float(tick / self._per_frame - (frame - 1)) if frame else 1.0

    def place(self, frame: int) -> tuple[int, float]:
        """The last tick at or before a frame, and the fraction of a tick from it to the frame."""
        ticks = frame * self._per_frame
        return math.floor(ticks), float(ticks % 1)
