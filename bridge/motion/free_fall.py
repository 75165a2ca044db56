"""Whether a motion's frame rate can be right: nobody falls much faster than gravity takes her.

A file's rate is a number that somebody wrote, and a wrong one still plays. At twice its rate a
motion is four times as violent, and so is the tissue that follows it. What gives it away is a jump.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bridge.motion.resampling import Motion
from bridge.motion.theta import unpack_theta

MOST_FALL_G = 2.5
"""The pelvis may fall faster than the body, whose arms and legs are thrown up meanwhile: 1.4 times
gravity in a real jumping jack, and 5.5 at twice its rate."""
_GRAVITY_M_S2 = 9.81
_HALF_S = 0.05


def steepest_fall_g(height_m: NDArray, fps: float) -> float:
    """Largest downward acceleration of a height (T,), in units of gravity; 0 if there is none.

    Each is the mean over a tenth of a second, weighted by a triangle of half its width h:
    -(y(t - h) - 2 y(t) + y(t + h)) / h^2. So an error of a millimetre makes no more than 0.2.
    """
    half = max(1, round(_HALF_S * fps))
    if len(height_m) <= 2 * half:
        return 0.0
    before, now, after = height_m[: -2 * half], height_m[half:-half], height_m[2 * half :]
    bent = (2 * now - before - after).max() * (fps / half) ** 2
    return max(0.0, float(bent) / _GRAVITY_M_S2)


def fall_warning(
    motion: Motion, pieces: Sequence[slice], remedy: str = "--motion-fps says the right one"
) -> str:
    """One line if the motion, y up, falls as nobody can; empty if it does not.

    Parameters
    ----------
    pieces : those between cuts, which are no falls.
    remedy : what to do if the rate is wrong.
    """
    height_m = unpack_theta(motion.theta)[1][:, 1]
    steepest_g = max(steepest_fall_g(height_m[piece], motion.fps) for piece in pieces)
    if steepest_g <= MOST_FALL_G:
        return ""
    fitting = motion.source_fps / np.sqrt(steepest_g)
    return (
        f"{motion.source} falls with {steepest_g:.1f} times gravity at its {motion.source_fps:g} "
        f"frames a second, where one of some {fitting:.0f} would fit: if it is wrong, {remedy}"
    )
