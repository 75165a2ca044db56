"""Noise to be added to a motion that has none: what a recording has faster than 8 Hz, or chance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.resampling import load_motion
from bridge.motion.theta import unpack_theta
from bridge.paper import N_JOINTS

FASTER_THAN_HZ = 8.0
WHITE_M, WHITE_DEG = 7e-4, 0.2


@dataclass(frozen=True)
class Noise:
    """What a recording has besides its smoothed self: turns in each joint's frame, and steps."""

    turns: NDArray[np.float64]
    """(T, 22, 3) axis-angle, radians."""
    steps_m: NDArray[np.float64]
    """(T, 3) metres."""

    @classmethod
    def of(cls, path: Path) -> Noise:
        """Of a recording, at 60 frames a second."""
        recorded, calm = (load_motion(path, smooth_hz=hz) for hz in (None, FASTER_THAN_HZ))
        (pose, trans_m), (calm_pose, calm_m) = map(unpack_theta, (recorded.theta, calm.theta))
        turns = Rotation.from_rotvec(calm_pose.reshape(-1, 3)).inv()
        turns = turns * Rotation.from_rotvec(pose.reshape(-1, 3))
        return cls(turns.as_rotvec().reshape(pose.shape), trans_m - calm_m)

    @classmethod
    def white(cls, frames: int, seed: int) -> Noise:
        """Of chance alone, the same at every frequency."""
        rng = np.random.default_rng(seed)
        turns = np.radians(WHITE_DEG) * rng.standard_normal((frames, N_JOINTS, 3))
        return cls(turns, WHITE_M * rng.standard_normal((frames, 3)))

    def added(self, pose: NDArray, trans_m: NDArray) -> tuple[NDArray, NDArray]:
        """A motion (T, 22, 3), (T, 3) with this noise, played forth and back where it is longer."""
        period = np.r_[np.arange(len(self.turns)), np.arange(len(self.turns))[::-1]]
        frames = np.resize(period, len(pose))
        turned = Rotation.from_rotvec(pose.reshape(-1, 3))
        turned = turned * Rotation.from_rotvec(self.turns[frames].reshape(-1, 3))
        return turned.as_rotvec().reshape(pose.shape), trans_m + self.steps_m[frames]
