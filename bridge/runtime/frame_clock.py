"""Frames that come at any rate, and the ticks, 60 a second, at which models compute."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion import pack_theta, unpack_theta
from bridge.motion.resampling import continuous_rotations
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


def between(before: NDArray, after: NDArray, share: NDArray) -> NDArray[np.float64]:
    """Poses (N, 69) at shares (N,) of the way from poses (N, 69) to poses (N, 69).

    As `load_amass_motion` resamples: rotations on the sphere, the short way, and translations
    linearly. A share of 1 gives `after` as it is.
    """
    if (share == 1).all():
        return after
    (pose, trans_m), (next_pose, next_trans_m) = unpack_theta(before), unpack_theta(after)
    first, second = (Rotation.from_rotvec(p.reshape(-1, 3)) for p in (pose, next_pose))
    turn = (first.inv() * second).as_rotvec() * share.repeat(pose.shape[1])[:, None]
    turned = (first * Rotation.from_rotvec(turn)).as_rotvec().reshape(pose.shape)
    turned = continuous_rotations(np.stack([pose, turned]).reshape(2, -1, 3))[1]
    moved_m = trans_m + share[:, None] * (next_trans_m - trans_m)
    found = pack_theta(turned.reshape(pose.shape), moved_m)
    return np.where(share[:, None] == 1, after, found)


def going_on(before: NDArray, last: NDArray) -> NDArray[np.float64]:
    """The pose (69,) after `last`, if the body goes on as it did from `before` to it."""
    (pose, trans_m), (last_pose, last_trans_m) = unpack_theta(before), unpack_theta(last)
    first, second = Rotation.from_rotvec(pose), Rotation.from_rotvec(last_pose)
    return pack_theta((second * first.inv() * second).as_rotvec(), 2 * last_trans_m - trans_m)
