"""Left and right: bodies, weights and blend shapes whose halves mirror each other exactly."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from bridge.body.model_data import SMPL_JOINT_NAMES

ACROSS = np.array([-1.0, 1.0, 1.0])
"""What a mirror does to x, y and z."""
_TWINS = {"left": "right", "right": "left"}
MIRRORED_JOINT = np.array(
    [
        SMPL_JOINT_NAMES.index("_".join([_TWINS.get(side, side), *rest]))
        for side, *rest in (name.split("_") for name in SMPL_JOINT_NAMES)
    ]
)
"""(24,) the joint on the other side; a joint of the middle is its own."""
_SAME_PLACE_M = 1e-4


def mirror_of(vertices: np.ndarray) -> np.ndarray:
    """(V,) the vertex on the other side of each of a symmetric mesh's (V, 3) vertices."""
    distance_m, mirror = map(np.asarray, KDTree(vertices).query(vertices * ACROSS))
    if distance_m.max() > _SAME_PLACE_M or (mirror[mirror] != np.arange(len(mirror))).any():
        raise ValueError(f"halves differ by up to {distance_m.max() * 1e3:.2f} mm")
    return mirror


def symmetric_points(points: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Mean of points or displacements (..., V, 3) and their mirror images, equal to the last bit.

    For joints, `mirror` is `MIRRORED_JOINT`.
    """
    return (points + points[..., mirror, :] * ACROSS) / 2.0


def symmetric_weights(weights: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Mean of skinning weights (V, 24) and their mirror images."""
    return (weights + weights[mirror][:, MIRRORED_JOINT]) / 2.0


def mirrored_poses(poses: np.ndarray) -> np.ndarray:
    """Axis-angle poses (N, 24, 3) seen in a mirror."""
    return poses[:, MIRRORED_JOINT] * -ACROSS


def mirrored_posedirs(posedirs: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Pose blend shapes (V, 3, 207) that do to a mirrored pose what these do to the pose."""
    by_joint = posedirs.reshape(len(posedirs), 3, -1, 3, 3)
    swapped = by_joint[mirror][:, :, MIRRORED_JOINT[1:] - 1]
    signs = ACROSS[:, None, None, None] * ACROSS[:, None] * ACROSS
    return (swapped * signs).reshape(posedirs.shape)
