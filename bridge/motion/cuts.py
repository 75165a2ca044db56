"""Frames of a file as no body moves: cuts, a rest pose put in front, and frames that repeat.

Recordings are joined, lose track, or loop: from one frame to the next the root is in another place,
or a joint is turned round. To what has a past, tissue or a recurrent network, that is a blow which
nobody gave. So each piece between cuts is a motion of its own, which begins from rest.

Conversions of whole libraries (CMU's) begin with a T, because a program can take the skeleton from
there, and jump into the motion within some frames: the same blow at every beginning.

A tracker that loses somebody repeats the last pose, and a motion of 30 frames a second is written
at 60 with each of them twice. Who halts slows down before: a body that stops dead and goes on at
once is the file's doing.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.theta import unpack_theta
from bridge.paper import N_JOINTS

CUT_M = 0.5
"""Least step of the root between two frames that is a cut: 15 m/s at 30 frames a second."""
CUT_RAD = np.radians(150.0)
"""Least turn of a joint between two frames that is one: a skater's spin of six turns a second makes
36 degrees in 1/60 s, a pitcher's arm 120."""
_NO_LEAVES = [joint for joint in range(N_JOINTS) if joint not in (10, 11, 20, 21)]
"""All but toes and wrists, which carry no flesh to speak of: where one flips, the body goes on."""
_FRAMES_AT_ONCE = 4096
_JUMP_RAD_S = np.radians(1500.0)
"""Least speed of a joint's first turn that is a jump out of a rest pose: only the fastest kick is
as fast, and a recording begins with what comes before it."""
_SETTLED_RAD_S = np.radians(700.0)
_LONGEST_JUMP_S = 0.1
_LONGEST_REPEAT_S = 0.25
_ABRUPT = 0.7
"""Of the speed one step farther from the repeats: of who turns back evenly it is a half."""
_SAME_1_S, _MOVING_1_S = 1e-6, 0.02
"""Root mean square of the speeds of all values, radians and metres a second: up to the first a
frame is the one before, but for rounding; from the second on somebody moves."""


def is_cut(before: NDArray, after: NDArray) -> NDArray[np.bool_]:
    """(N,) whether there is a cut from theta (N, 69) to the frame after it (N, 69)."""
    (pose, trans_m), (next_pose, next_trans_m) = unpack_theta(before), unpack_theta(after)
    turn_rad = turns_rad(pose[:, _NO_LEAVES], next_pose[:, _NO_LEAVES]).max(axis=1)
    far_m = np.linalg.norm(next_trans_m - trans_m, axis=1)
    return (far_m >= CUT_M) | (turn_rad >= CUT_RAD)


def find_cuts(theta: NDArray) -> tuple[int, ...]:
    """The first frame after each cut of a motion (T, 69)."""
    theta, begins = np.asarray(theta, np.float64), []
    for first in range(0, len(theta) - 1, _FRAMES_AT_ONCE):
        part = theta[first : first + _FRAMES_AT_ONCE + 1]
        begins.extend((np.flatnonzero(is_cut(part[:-1], part[1:])) + first + 1).tolist())
    return tuple(begins)


def pieces_between_cuts(theta: NDArray) -> list[slice]:
    """The frames of a motion (T, 69) as pieces without a cut: slices that follow one another."""
    return [slice(*ends) for ends in pairwise([0, *find_cuts(theta), len(theta)])]


def predict_between_cuts(predict: Callable[[NDArray], NDArray], theta: NDArray) -> NDArray:
    """What `predict` makes of every piece of a motion (T, 69), one after another: (T, ...)."""
    return np.concatenate([predict(theta[piece]) for piece in pieces_between_cuts(theta)])


def frames_of_rest_pose(pose: NDArray[np.floating], fps: float) -> int:
    """How many frames of a pose (T, J, 3) come before the motion: those up to the end of a jump.

    At most a tenth of a second, and never so many that fewer than two are left; mostly 0.
    """
    steps = min(max(1, round(_LONGEST_JUMP_S * fps)), len(pose) - 2)
    if steps < 1:
        return 0
    speed_rad_s = turns_rad(pose[:steps], pose[1 : steps + 1]).max(axis=1) * fps
    if speed_rad_s[0] < _JUMP_RAD_S:
        return 0
    return int(np.flatnonzero(speed_rad_s >= _SETTLED_RAD_S)[-1]) + 1


def repeated_frames(values: NDArray, fps: float) -> NDArray[np.bool_]:
    """(T,) which of the frames (T, ...) of a pose or a mesh repeat the one before, for at most a
    quarter of a second, while the body moves as fast as ever just before and after."""
    flat = np.asarray(values, np.float64).reshape(len(values), -1)
    speed = np.sqrt(np.square(np.diff(flat, axis=0)).mean(axis=1)) * fps
    moves = np.flatnonzero(speed > _SAME_1_S)
    before, after = moves[:-1], moves[1:]
    beyond = np.pad(speed, 1)
    chosen = after - before > 1
    chosen &= after - before - 1 <= _LONGEST_REPEAT_S * fps
    chosen &= np.minimum(speed[before], speed[after]) >= _MOVING_1_S
    chosen &= speed[before] >= _ABRUPT * beyond[before]
    chosen &= speed[after] >= _ABRUPT * beyond[after + 2]
    repeats = np.zeros(len(flat), bool)
    for first, last in zip(before[chosen], after[chosen], strict=True):
        repeats[first + 2 : last + 1] = True
    return repeats


def turns_rad(pose: NDArray, next_pose: NDArray) -> NDArray[np.float64]:
    """(N, J) angles between joint rotations (N, J, 3) of frames and those after them."""
    before, after = (Rotation.from_rotvec(p.reshape(-1, 3)) for p in (pose, next_pose))
    return (before.inv() * after).magnitude().reshape(len(pose), -1)
