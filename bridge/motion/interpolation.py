"""Poses between two poses, and after them: rotations on the sphere, translations on lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.resampling import continuous_rotations
from bridge.motion.theta import pack_theta, unpack_theta


def between(before: NDArray, after: NDArray, share: NDArray) -> NDArray[np.floating]:
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
    both = np.stack([pose, turned]).reshape(2, -1, 3).astype(np.float64)
    turned = continuous_rotations(both)[1]
    moved_m = trans_m + share[:, None] * (next_trans_m - trans_m)
    found = pack_theta(turned.reshape(pose.shape), moved_m)
    return np.where(share[:, None] == 1, after, found)


def going_on(before: NDArray, last: NDArray) -> NDArray[np.floating]:
    """The pose (69,) after `last`, if the body goes on as it did from `before` to it."""
    (pose, trans_m), (last_pose, last_trans_m) = unpack_theta(before), unpack_theta(last)
    first, second = Rotation.from_rotvec(pose), Rotation.from_rotvec(last_pose)
    return pack_theta((second * first.inv() * second).as_rotvec(), 2 * last_trans_m - trans_m)
