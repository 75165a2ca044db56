"""Where the model's ticks, 60 a second, lie among a stream's frames of any rate."""

from __future__ import annotations

import math
from fractions import Fraction

from bridge.errors import DsnetError
from bridge.paper import FPS

_RATES_HZ = (10.0, 1000.0)
"""Slower than the slowest, motion between frames is guessed; faster, nobody shows it."""
_LARGEST_DENOMINATOR = 1001
"""Television's rates are thousands over 1001."""


class FrameClock:
    """Which ticks, 60 a second, at which models compute, lie where among frames of any rate.

    Counted in fractions, so it is never off. Frame 0 is at tick 0.
    """

    def __init__(self, fps: float) -> None:
        try:
            self.fps = float(fps)  # or a file's, which may be an array
        except (TypeError, ValueError):
            self.fps = math.nan
        if not _RATES_HZ[0] <= self.fps <= _RATES_HZ[1]:  # nan is not
            raise DsnetError(
                f"fps={fps}", f"{_RATES_HZ[0]:g} to {_RATES_HZ[1]:g}", "Pass frames per second."
            )
        per_tick = Fraction(self.fps).limit_denominator(_LARGEST_DENOMINATOR)
        self._per_frame = Fraction(int(FPS)) / per_tick

    def latency_frames(self, look_ahead: int) -> int:
        """Frames that an answer is late if a tick's is known `look_ahead` ticks later.

        The newest tick may lie almost a whole one before the newest frame.
        """
        return math.ceil(
            (look_ahead + 1 - Fraction(1, self._per_frame.denominator)) / self._per_frame
        )

    def ticks(self, frame: int) -> range:
        """Those after the frame before this one, up to this one."""
        before, now = (math.floor(f * self._per_frame) for f in (frame - 1, frame))
        return range(before + 1, now + 1) if frame else range(1)

    def share(self, tick: int, frame: int) -> float:
        """Where a tick of `ticks(frame)` lies from the frame before, 0, to this one, 1."""
        return float(tick / self._per_frame - (frame - 1)) if frame else 1.0

    def place(self, frame: int) -> tuple[int, float]:
        """The last tick not after a frame, and the share of a tick from there to the frame."""
        ticks = frame * self._per_frame
        return math.floor(ticks), float(ticks % 1)
