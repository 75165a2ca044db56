"""A recording without its tremor: what changes faster than people move is mostly noise.

Tissue feels accelerations, in which noise grows with the square of its frequency, and swings at 5
to 15 Hz of its own. Biomechanics filters recordings of markers at 6 to 12 Hz for the same reason
(Winter, *Biomechanics and Motor Control of Human Movement*): by a Butterworth filter of second
order, once forwards and once backwards, so that nothing is late. How fast somebody moves differs
from motion to motion, and so does the cutoff that suits: `auto` seeks it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.amass_file import StoredMotion
from bridge.motion.cuts import find_cuts
from bridge.motion.valley import cutoffs_hz, most_cutoff_hz

SmoothHz: TypeAlias = float | Literal["auto"]
"""A cutoff in Hz, or what suits each moment."""
_PADDED_FRAMES = 9
_BANK_HZ = (4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24)


def smoothed(stored: StoredMotion, smooth_hz: SmoothHz) -> StoredMotion:
    """The motion without what is faster than a cutoff, piece by piece between cuts.

    Rotations are filtered as quaternions, which are made unit quaternions again.

    Parameters
    ----------
    smooth_hz : cutoff in Hz; `auto`: what suits each moment of it (`bridge.motion.valley`).

    Raises
    ------
    DsnetError
        If the motion has no frames so fast.
    """
    if smooth_hz != "auto" and not 0 < smooth_hz < stored.fps / 2:
        raise DsnetError(
            f"a motion of {stored.fps:g} frames a second, smoothed at {smooth_hz:g} Hz",
            f"more than 0 and less than {stored.fps / 2:g} Hz, half its rate",
            "Pass auto, or 6 to 12.",
        )
    pose, trans_m = stored.pose.copy(), stored.trans_m.copy()
    starts = [0, *find_cuts(stored.pose, stored.trans_m), len(stored.pose)]
    for piece in (slice(first, end) for first, end in pairwise(starts)):
        calmed = _filter_for(stored.pose[piece], stored.trans_m[piece], stored.fps, smooth_hz)
        trans_m[piece] = calmed(stored.trans_m[piece])
        turns = _continuous_quaternions(stored.pose[piece])
        rotations = Rotation.from_quat(calmed(turns).reshape(-1, 4))
        pose[piece] = rotations.as_rotvec().reshape(pose[piece].shape)
    return replace(stored, pose=pose, trans_m=trans_m)


def described(smooth_hz: SmoothHz | None) -> str:
    """As in a sentence about a motion."""
    if smooth_hz is None:
        return "as it is"
    return "smoothed as it moves" if smooth_hz == "auto" else f"smoothed at {smooth_hz:g} Hz"


def _filter_for(
    pose: NDArray, trans_m: NDArray, fps: float, smooth_hz: SmoothHz
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    if smooth_hz == "auto":
        chosen_hz = cutoffs_hz(pose, trans_m, fps)
        return lambda values: _blended(values, chosen_hz, fps)
    return lambda values: _low_passed(values, smooth_hz, fps)


def _blended(
    values: NDArray[np.float64], chosen_hz: NDArray[np.float64], fps: float
) -> NDArray[np.float64]:
    """Values (T, ...) each with its own cutoff (T,): between those of the two next to it in a bank
    of filters, in proportion to the logarithm of frequency. The last of the bank lets all pass."""
    most_hz = most_cutoff_hz(fps)
    bank_hz = [*(hz for hz in _BANK_HZ if hz < most_hz), most_hz]
    place = np.interp(np.log(chosen_hz), np.log(bank_hz), np.arange(len(bank_hz)))
    found = np.zeros_like(values)
    for number, hz in enumerate(bank_hz):
        share = np.clip(1 - np.abs(place - number), 0, 1)
        if share.any():
            passed = values if hz == most_hz else _low_passed(values, hz, fps)
            found += share.reshape(-1, *[1] * (values.ndim - 1)) * passed
    return found


def _low_passed(values: NDArray[np.float64], hz: float, fps: float) -> NDArray[np.float64]:
    if len(values) < 2:
        return values
    sections = np.asarray(butter(2, hz, fs=fps, output="sos"))
    padded = min(_PADDED_FRAMES, len(values) - 1)
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padded))


def _continuous_quaternions(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, J, 4) of rotations (T, J, 3); of q and -q, the one nearer to the frame before."""
    turns = Rotation.from_rotvec(pose.reshape(-1, 3)).as_quat().reshape(*pose.shape[:2], 4)
    opposite = (turns[1:] * turns[:-1]).sum(axis=-1) < 0
    signs = np.where(np.cumsum(opposite, axis=0) % 2 == 1, -1.0, 1.0)
    turns[1:] *= signs[..., None]
    return turns
