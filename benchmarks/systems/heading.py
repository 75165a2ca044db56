"""Betas and theta with the place in the room and the heading taken out, as motion models have it.

The paper's theta (Section 3.2) says where the body stands and which way it faces. Tissue feels
neither, and a motion elsewhere in the room is new to a network that was told both in training.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.systems.kinematics import CHANGE_FRAMES
from bridge.motion import unpack_theta
from bridge.paper import N_BETAS


def heading_aligned(joined: NDArray) -> NDArray[np.floating]:
    """Of betas and theta (T, 79): what stays of them wherever the body is, (T, 80).

    Betas; the pose (66) with its root turned about the vertical until it faces ahead, so that
    leaning and lying stay; how far the root went since the last frame, as seen by who faces ahead
    (3), and how far its heading turned (1). The last two are scaled to what they amount to in
    0.1 s (m, rad), as differences of poses are, and 0 in the first frame.
    """
    pose, trans_m = unpack_theta(np.asarray(joined[:, N_BETAS:], np.float64))
    root = Rotation.from_rotvec(pose[:, 0])
    heading_rad = np.unwrap(headings(root))
    back = Rotation.from_rotvec(np.outer(-heading_rad, [0.0, 1.0, 0.0]))
    aligned = pose.copy()
    aligned[:, 0] = (back * root).as_rotvec()
    steps, turned = np.zeros_like(trans_m), np.zeros((len(pose), 1))
    steps[1:] = back[1:].apply(np.diff(trans_m, axis=0))
    turned[1:, 0] = np.diff(heading_rad)
    parts = (
        joined[:, :N_BETAS],
        aligned.reshape(len(pose), -1),
        CHANGE_FRAMES * steps,
        CHANGE_FRAMES * turned,
    )
    return np.concatenate(parts, axis=1)


def headings(root: Rotation) -> NDArray[np.float64]:
    """Angles (T,) rad about y, which is up: R = R_y(angle) S, S without a turn about y.

    By the quaternion's twist: 2 atan2(q_y, q_w). Defined for whoever stands, leans or lies; not for
    a body on its head, which faces every way at once.
    """
    x_y_z_w = root.as_quat()
    return 2.0 * np.arctan2(x_y_z_w[..., 1], x_y_z_w[..., 3])
