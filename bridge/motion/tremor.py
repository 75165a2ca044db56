"""Whether a recording trembles: noise of a millimetre that no eye sees shakes tissue visibly.

At 15 Hz a millimetre is nearly a gravity of acceleration. What moves a body is slower than 10 Hz
but for moments, so the median over a motion of what is faster tells the noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from bridge.motion.resampling import Motion
from bridge.motion.theta import unpack_theta

MOST_TREMOR_MM = 0.45
"""Motions without noise stay below 0.2, ours and a real jumping jack; most of CMU's early
recordings are above it."""
FASTER_THAN_HZ = 10.0
_FEWEST_FRAMES = 30


def tremor_mm(trans_m: NDArray[np.floating], fps: float) -> float:
    """Median size of what is faster than 10 Hz in a path (T, 3), metres; 0 of half a second."""
    if len(trans_m) < _FEWEST_FRAMES or fps <= 2 * FASTER_THAN_HZ:
        return 0.0
    sections = butter(2, FASTER_THAN_HZ, btype="high", fs=fps, output="sos")
    fast_m = np.asarray(sosfiltfilt(sections, trans_m, axis=0))
    return 1e3 * float(np.median(np.linalg.norm(fast_m, axis=1)))


def tremor_warning(motion: Motion, pieces: Sequence[slice], remedy: str) -> str:
    """One line if the root trembles; empty if it does not.

    Parameters
    ----------
    pieces : those between cuts.
    remedy : how the noise is left out.
    """
    trans_m = unpack_theta(motion.theta)[1]
    most_mm = max((tremor_mm(trans_m[piece], motion.fps) for piece in pieces), default=0.0)
    if most_mm <= MOST_TREMOR_MM:
        return ""
    return (
        f"{motion.source} trembles by {most_mm:.1f} mm above {FASTER_THAN_HZ:g} Hz, as noisy "
        f"recordings do, and shakes the tissue: {remedy} leaves that out"
    )
