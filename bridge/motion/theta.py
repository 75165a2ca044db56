"""The paper's pose vector (Section 3.2).

theta_t holds 22 joints x 3 axis-angle components (root first, hands left out) and then the root's
translation: 22 x 3 + 3 = 69. SMPL's own `body_pose` is 69 wide too and is something else (23
joints, no root, no translation). No other module packs or unpacks the 69 numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.errors import DsnetError
from bridge.paper import N_JOINTS, THETA_SIZE


def pack_theta(pose: ArrayLike, trans_m: ArrayLike) -> NDArray[np.floating]:
    """Joint rotations (..., >= 22, 3) axis-angle and translation (..., 3) m to theta (..., 69).

    Joints beyond the 22nd (SMPL's hands) are dropped, as in the paper.
    """
    pose, trans_m = np.asarray(pose), np.asarray(trans_m)
    if pose.shape[-2] < N_JOINTS or pose.shape[-1] != 3 or trans_m.shape[-1] != 3:
        raise DsnetError(
            f"pose {pose.shape} and translation {trans_m.shape}",
            "pose (..., 22 or more, 3) and translation (..., 3)",
            "Pass axis-angle joint rotations and metres.",
        )
    body = pose[..., :N_JOINTS, :].reshape(*pose.shape[:-2], 3 * N_JOINTS)
    return np.concatenate([body, trans_m], axis=-1)


def unpack_theta(theta: ArrayLike) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """theta (..., 69) to joint rotations (..., 22, 3) axis-angle and translation (..., 3) m."""
    theta = np.asarray(theta)
    if theta.shape[-1] != THETA_SIZE:
        raise DsnetError(
            f"theta of shape {theta.shape}",
            f"a last axis of {THETA_SIZE}",
            "Pack it with bridge.motion.pack_theta.",
        )
    return theta[..., :-3].reshape(*theta.shape[:-1], N_JOINTS, 3), theta[..., -3:]
