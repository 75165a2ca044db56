"""Random poses within what human joints can do, to fit the pose blend shapes on."""

from __future__ import annotations

import numpy as np

# Axis-angle limits in radians, low and high of x, y, z, in SMPL's T-pose frame. For the left side
# and the middle: -x bends a hip forward, +x bends a knee, -y brings an arm forward and bends an
# elbow, -z lowers an arm. The right side mirrors y and z.
_LIMITS_RAD: dict[tuple[int, ...], tuple[tuple[float, float], ...]] = {
    (1, 2): ((-2.3, 0.5), (-0.6, 0.6), (-0.5, 0.9)),
    (4, 5): ((0.0, 2.4), (-0.1, 0.1), (-0.1, 0.1)),
    (7, 8): ((-0.6, 0.8), (-0.3, 0.3), (-0.3, 0.3)),
    (10, 11): ((-0.7, 0.5), (-0.1, 0.1), (-0.1, 0.1)),
    (3, 6, 9): ((-0.25, 0.5), (-0.35, 0.35), (-0.3, 0.3)),
    (12, 15): ((-0.4, 0.5), (-0.6, 0.6), (-0.35, 0.35)),
    (13, 14): ((-0.4, 0.2), (-0.45, 0.35), (-0.2, 0.8)),
    (16, 17): ((-0.9, 0.9), (-1.7, 0.6), (-1.5, 1.5)),
    (18, 19): ((-0.7, 0.7), (-2.4, 0.0), (-0.15, 0.15)),
    (20, 21): ((-0.5, 0.5), (-0.5, 0.5), (-1.0, 1.0)),
    (22, 23): ((-0.1, 0.1), (-0.2, 0.2), (-0.5, 0.3)),
}
# Collar and shoulder together raise an arm no farther than this: upright.
_HIGHEST_ARM_RAD = 1.65
_RIGHT_JOINTS = (2, 5, 8, 11, 14, 17, 19, 21, 23)


def sample_poses(count: int, seed: int) -> np.ndarray:
    """(count, 24, 3) axis-angle poses, uniform within each joint's limits; the root is still."""
    rng = np.random.default_rng(seed)
    low, high = np.zeros((24, 3)), np.zeros((24, 3))
    for joints, limits in _LIMITS_RAD.items():
        for joint in joints:
            low[joint], high[joint] = np.array(limits).T
    poses = rng.uniform(low, high, (count, 24, 3))
    poses[:, [16, 17], 2] = np.minimum(
        poses[:, [16, 17], 2], _HIGHEST_ARM_RAD - poses[:, [13, 14], 2]
    )
    poses[:, _RIGHT_JOINTS, 1:] *= -1.0
    return poses
