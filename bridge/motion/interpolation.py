"""Poses between frames: rotations on the sphere (SLERP, the short way) joint by joint, all else
linearly; or all on cubic splines, of quaternions for rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.motion.motion import Motion
from bridge.motion.smoothing import continuous_quaternions, continuous_rotations
from bridge.motion.theta import pack_theta, unpack_theta


def values_on_lines(motion: Motion) -> NDArray[np.float64]:
    """(T, 3) translation, or (T, 11) with DMPL's coefficients: what goes on straight lines."""
    lines = [motion.trans_m, *([] if motion.dmpls is None else [motion.dmpls])]
    return np.concatenate(lines, axis=1)


def straight(
    pose: NDArray, values: NDArray, source_s: NDArray, at_s: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pose (T, J, 3) and values (T, n) at other times, on straight lines and great circles."""
    moved = np.stack([np.interp(at_s, source_s, column) for column in values.T], axis=1)
    if len(pose) > 1:
        turns = [Slerp(source_s, Rotation.from_rotvec(joint)) for joint in pose.swapaxes(0, 1)]
        pose = np.stack([slerp(at_s).as_rotvec() for slerp in turns], axis=1)
    return pose, moved


def curved(
    pose: NDArray, values: NDArray, source_s: NDArray, at_s: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same on cubic splines."""
    from scipy.interpolate import CubicSpline  # slow to load, and rarely needed

    turns = CubicSpline(source_s, continuous_quaternions(pose))(at_s)
    turned = Rotation.from_quat(turns.reshape(-1, 4)).as_rotvec()
    moved = np.asarray(CubicSpline(source_s, values)(at_s), np.float64)
    return turned.reshape(len(at_s), -1, 3), moved


def between(before: NDArray, after: NDArray, share: NDArray) -> NDArray[np.floating]:
    """Poses (N, 69) at shares (N,) of the way from poses (N, 69) to poses (N, 69).

    A share of 1 gives `after` as it is.
    """
    if (share == 1).all():
        return after
    (pose, trans_m), (next_pose, next_trans_m) = unpack_theta(before), unpack_theta(after)
    first, second = (Rotation.from_rotvec(p.reshape(-1, 3)) for p in (pose, next_pose))
    turn = (first.inv() * second).as_rotvec() * share.repeat(pose.shape[1])[:, None]
    turned = (first * Rotation.from_rotvec(turn)).as_rotvec().reshape(pose.shape)
    both = np.stack([pose, turned]).reshape(2, -1, 3).astype(np.float64)
    turned = continuous_rotations(both)[1]
    moved_m = trans_m + share[:, None] * (next_trans_m - trans_m)
    theta = pack_theta(turned.reshape(pose.shape), moved_m)
    return np.where(share[:, None] == 1, after, theta)


def going_on(before: NDArray, last: NDArray) -> NDArray[np.floating]:
    """The pose (69,) after `last`, if the body goes on as it did from `before` to it."""
    (pose, trans_m), (last_pose, last_trans_m) = unpack_theta(before), unpack_theta(last)
    first, second = Rotation.from_rotvec(pose), Rotation.from_rotvec(last_pose)
    return pack_theta((second * first.inv() * second).as_rotvec(), 2 * last_trans_m - trans_m)
