"""A motion whose joints and root turn and travel, and the same one elsewhere in the room."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion import pack_theta, unpack_theta


def lively(frames: int = 40, seed: int = 0) -> NDArray:
    """A motion whose joints and root turn and travel smoothly."""
    rng = np.random.default_rng(seed)
    phases, rates = rng.uniform(0, 2 * np.pi, (1, 69)), rng.uniform(0.05, 0.2, (1, 69))
    return 0.7 * np.sin(rates * np.arange(frames)[:, None] + phases)


def moved(theta: NDArray, turn: Rotation, shift_m: NDArray) -> NDArray:
    """The motion in a world that is turned and shifted."""
    pose, trans = unpack_theta(theta)
    pose = pose.copy()
    pose[:, 0] = (turn * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    return pack_theta(pose, turn.apply(trans) + shift_m)
