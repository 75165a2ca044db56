"""How fast people move at most: what is faster is a fault of the recording, or of its rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion.cuts import turns_rad
from bridge.paper import N_JOINTS

MOST_TURN_DEG_S = 3500.0
"""Of trunk and legs: between the fastest ankles in recorded dances and the faults beside them."""
MOST_ARM_TURN_DEG_S = 8000.0
"""Of the arms, the neck and the head: more than a pitcher's shoulder reaches."""
MOST_ROOT_G = 20.0
"""Of the root's acceleration from frame to frame: more than recorded landings have."""
GRAVITY_M_S2 = 9.81
WHAT_MOVES = [*SMPL_JOINT_NAMES[:N_JOINTS], "root"]
"""Joints that turn, and the root's place: columns of `excess_speeds`."""
_ARMS = ("neck", "head", "collar", "shoulder", "elbow", "wrist")
_MOST_TURNS_DEG_S = np.array(
    [
        MOST_ARM_TURN_DEG_S if name.endswith(_ARMS) else MOST_TURN_DEG_S
        for name in WHAT_MOVES[:N_JOINTS]
    ]
)


def excess_speeds(
    pose: NDArray[np.floating], trans_m: NDArray[np.floating], fps: float
) -> NDArray[np.float64]:
    """(T, 23) in parts of what people reach: how fast each joint of a pose (T, 22, 3) has turned
    since the frame before, and how much the root's path (T, 3), metres, is bent there."""
    excess = np.zeros((len(pose), N_JOINTS + 1))
    if len(pose) > 1:
        turn_deg = np.degrees(turns_rad(pose[:-1], pose[1:]))
        excess[1:, :N_JOINTS] = turn_deg * fps / _MOST_TURNS_DEG_S
        bent_m = np.linalg.norm(np.diff(trans_m, 2, axis=0), axis=1)
        excess[1:-1, N_JOINTS] = bent_m * fps**2 / (MOST_ROOT_G * GRAVITY_M_S2)
    return excess
