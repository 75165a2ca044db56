"""What some BVH files show before the motion: a rest pose, from which it leaps into the first one.

Conversions of whole libraries begin so (CMU's, in which the arms then fall from a T within some
frames), because a program can take the skeleton from there. To tissue it is a blow that nobody
gave, at every beginning.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.motion.cuts import turns_rad

LEAP_RAD_S = np.radians(1500.0)
"""Least speed of a joint's first turn that is a leap: only the fastest kick is as fast, and a
recording begins with what comes before it."""
_SETTLED_RAD_S = np.radians(700.0)
_LONGEST_S = 0.1


def lead_in_frames(pose: NDArray[np.floating], fps: float) -> int:
    """How many frames come before the motion: 0, or those up to the end of a leap from the first.

    At most a tenth of a second, and never so many that fewer than two are left.

    Parameters
    ----------
    pose : (T, J, 3) joint rotations relative to their parents, axis-angle.
    fps : frames per second.
    """
    steps = min(max(1, round(_LONGEST_S * fps)), len(pose) - 2)
    if steps < 1:
        return 0
    speed_rad_s = turns_rad(pose[:steps], pose[1 : steps + 1]).max(axis=1) * fps
    if speed_rad_s[0] < LEAP_RAD_S:
        return 0
    return int(np.flatnonzero(speed_rad_s >= _SETTLED_RAD_S)[-1]) + 1
