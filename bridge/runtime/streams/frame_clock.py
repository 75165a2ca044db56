"""Frames that come at any rate, and the ticks, 60 a second, at which models compute."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

from bridge.errors import DsnetError
from bridge.tissue.oscillators import FPS

RATES_HZ = (10.0, 1000.0)
"""Slower than the slowest, motion between frames is guessed; faster, nobody shows it."""
_LARGEST_DENOMINATOR = 1001
"""Television's rates are thousands over 1001."""


class FrameClock:
    """Which ticks lie where among frames. Counted in fractions, so it is never off.

    Frame 0 is at tick 0.

    Parameters
    ----------
    fps : frames per second.

    Raises
    ------
    DsnetError
        If that is no rate of frames.
    """

    def __init__(self, fps: float) -> None:
        if not RATES_HZ[0] <= fps <= RATES_HZ[1]:  # nan is not
            raise DsnetError(
                f"fps={fps}", f"{RATES_HZ[0]:g} to {RATES_HZ[1]:g}", "Pass frames per second."
            )
        self.fps = float(fps)
        exact = Fraction(fps).limit_denominator(_LARGEST_DENOMINATOR)
        self._ticks_per_frame = Fraction(int(FPS)) / exact

    def latency_frames(self, look_ahead: int) -> int:
        """Frames that an answer is late if a tick's is known `look_ahead` ticks later.

        The newest tick may lie almost a whole one before the newest frame.
        """
        per_frame = self._ticks_per_frame
        return ceil((look_ahead + 1 - Fraction(1, per_frame.denominator)) / per_frame)

    def ticks(self, frame: int) -> range:
        """Those after the frame before this one, up to this one."""
        before, now = ((f * self._ticks_per_frame).__floor__() for f in (frame - 1, frame))
        return range(before + 1, now + 1) if frame else range(1)

    def share(self, tick: int, frame: int) -> float:
        """Where a tick of `ticks(frame)` lies from the frame before, 0, to this one, 1."""
        return float(tick / self._ticks_per_frame - (frame - 1)) if frame else 1.0

    def place(self, frame: int) -> tuple[int, float]:
        """The last tick not after a frame, and the share of a tick from there to the frame."""
        ticks = frame * self._ticks_per_frame
        return ticks.__floor__(), float(ticks % 1)
