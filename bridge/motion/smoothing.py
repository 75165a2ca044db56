"""A recording without its tremor: what changes faster than people move is mostly noise.

Tissue feels accelerations, in which noise grows with the square of its frequency, and swings at 5
to 15 Hz of its own. Biomechanics filters recordings of markers at 6 to 12 Hz for the same reason
(Winter, *Biomechanics and Motor Control of Human Movement*): by a Butterworth filter of second
order, once forwards and once backwards, so that nothing is late.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.amass_file import StoredMotion
from bridge.motion.cuts import find_cuts

_PADDED_FRAMES = 9


def smoothed(stored: StoredMotion, cutoff_hz: float) -> StoredMotion:
    """The motion without what is faster than `cutoff_hz`, piece by piece between cuts.

    Rotations are filtered as quaternions, which are made unit quaternions again.

    Raises
    ------
    DsnetError
        If the motion has no frames so fast.
    """
    if not 0 < cutoff_hz < stored.fps / 2:
        raise DsnetError(
            f"a motion of {stored.fps:g} frames a second, smoothed at {cutoff_hz:g} Hz",
            f"more than 0 and less than {stored.fps / 2:g} Hz, half its rate",
            "Pass 6 to 12.",
        )
    sections = np.asarray(butter(2, cutoff_hz, fs=stored.fps, output="sos"))
    pose, trans_m = stored.pose.copy(), stored.trans_m.copy()
    starts = [0, *find_cuts(stored.pose, stored.trans_m), len(stored.pose)]
    for piece in (slice(first, end) for first, end in pairwise(starts)):
        trans_m[piece] = _filtered(sections, stored.trans_m[piece])
        turns = _continuous_quaternions(stored.pose[piece])
        rotations = Rotation.from_quat(_filtered(sections, turns).reshape(-1, 4))
        pose[piece] = rotations.as_rotvec().reshape(pose[piece].shape)
    return replace(stored, pose=pose, trans_m=trans_m)


def _filtered(sections: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    if len(values) < 2:
        return values
    padded = min(_PADDED_FRAMES, len(values) - 1)
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padded))


def _continuous_quaternions(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T, J, 4) of rotations (T, J, 3); of q and -q, the one nearer to the frame before."""
    turns = Rotation.from_rotvec(pose.reshape(-1, 3)).as_quat().reshape(*pose.shape[:2], 4)
    opposite = (turns[1:] * turns[:-1]).sum(axis=-1) < 0
    signs = np.where(np.cumsum(opposite, axis=0) % 2 == 1, -1.0, 1.0)
    turns[1:] *= signs[..., None]
    return turns
