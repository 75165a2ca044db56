"""Cuts in a motion: frames between which no body can have moved.

Recordings are joined, lose track, or loop: from one frame to the next the root is elsewhere, or a
joint is turned round. To what has a past, tissue or a recurrent network, that is a blow which
nobody gave. So each piece between cuts is a motion of its own, which begins from rest.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.theta import unpack_theta

CUT_M = 0.5
"""Least step of the root between two frames that is a cut: 15 m/s at 30 frames a second."""
CUT_RAD = np.radians(150.0)
"""Least turn of a joint between two frames that is one: a skater's spin of six turns a second makes
36 degrees in 1/60 s, a pitcher's arm 120."""
_FRAMES_AT_ONCE = 4096


def find_cuts(pose: ArrayLike, trans_m: ArrayLike) -> list[int]:
    """The first frame after each cut, ascending.

    Parameters
    ----------
    pose : (T, J, 3) joint rotations relative to their parents, axis-angle.
    trans_m : (T, 3) translation of the root, metres.
    """
    pose, trans_m = np.asarray(pose, np.float64), np.asarray(trans_m, np.float64)
    cuts: list[int] = []
    for first in range(0, len(pose) - 1, _FRAMES_AT_ONCE):
        frames = slice(first, first + _FRAMES_AT_ONCE)
        after = pose[1:][frames], trans_m[1:][frames]
        jumps = _jumps(pose[:-1][frames], trans_m[:-1][frames], *after)
        cuts.extend((np.flatnonzero(jumps) + first + 1).tolist())
    return cuts


def is_cut(before: NDArray, after: NDArray) -> NDArray[np.bool_]:
    """(N,) whether there is a cut from theta (N, 69) to the frame after it (N, 69)."""
    return _jumps(*unpack_theta(before), *unpack_theta(after))


def pieces_between_cuts(theta: NDArray) -> list[slice]:
    """The frames of a motion (T, 69) as pieces without a cut: slices that follow one another."""
    cuts = find_cuts(*unpack_theta(theta))
    return [slice(first, end) for first, end in pairwise([0, *cuts, len(theta)])]


def predict_between_cuts(predict: Callable[[NDArray], NDArray], theta: NDArray) -> NDArray:
    """What `predict` makes of every piece of a motion (T, 69), one after another: (T, ...)."""
    return np.concatenate([predict(theta[piece]) for piece in pieces_between_cuts(theta)])


def turns_rad(pose: NDArray, next_pose: NDArray) -> NDArray[np.float64]:
    """(N, J) angles between joint rotations (N, J, 3) of frames and those after them."""
    before, after = (Rotation.from_rotvec(p.reshape(-1, 3)) for p in (pose, next_pose))
    return (before.inv() * after).magnitude().reshape(len(pose), -1)


def _jumps(
    pose: NDArray, trans_m: NDArray, next_pose: NDArray, next_trans_m: NDArray
) -> NDArray[np.bool_]:
    """(N,) for joint rotations (N, J, 3) and translations (N, 3) of frames and those after them."""
    turn_rad = turns_rad(pose, next_pose).max(axis=1)
    far_m = np.linalg.norm(next_trans_m - trans_m, axis=1)
    return (far_m >= CUT_M) | (turn_rad >= CUT_RAD)
