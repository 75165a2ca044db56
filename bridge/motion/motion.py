"""A motion that a body can follow, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.smoothing import SmoothHz
from bridge.motion.theta import pack_theta, unpack_theta

UpAxis = Literal["y", "z"]
Y_UP_FROM_Z_UP = Rotation.from_euler("x", -90, degrees=True)
DEFAULT_FPS = 60.0
"""Dyna's rate, to which the paper resamples all motions (Table 1)."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion that a 22-joint body can follow."""

    theta: NDArray[np.floating]
    """(T, 69) pose vector of the paper: 22 x 3 axis-angle, radians, and translation, metres."""
    betas: NDArray[np.float64]
    """(10,) first shape coefficients. Those of an SMPL-X file live in SMPL-X's shape space."""
    gender: str
    """`female`, `male`, `neutral`, or `unknown` where the file does not say."""
    fps: float
    """Frames per second of `theta`."""
    source_fps: float
    """Frames per second of the file."""
    source: Path
    """The file."""
    up: UpAxis = "y"
    """Vertical axis of `theta`'s root."""
    dmpls: NDArray[np.float64] | None = None
    """(T, 8) DMPL soft tissue coefficients, where the file has them."""
    lead_in: int = 0
    """Frames of the file that come before the motion and are left out."""
    smooth_hz: SmoothHz | None = None
    """What was faster in the file is left out; `auto`: than what suits each moment."""

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, seconds."""
        return (len(self.theta) - 1) / self.fps

    def about_root_joint(self, root_joint_m: ArrayLike) -> Motion:
        """The motion for a body whose root joint rests at `root_joint_m` (3,) instead of 0.

        SMPL turns the root about its rest position J0, so the file's root joint is at
        J0 + trans, and turning the world turns that sum: trans' = R (J0 + trans) - J0. A motion
        that was read without J0 lacks the constant R J0 - J0.
        """
        if self.up == "z":
            return self
        joint = np.asarray(root_joint_m, dtype=np.float64)
        pose, trans = unpack_theta(self.theta)
        shift = Y_UP_FROM_Z_UP.apply(joint) - joint
        return replace(self, theta=pack_theta(pose, trans + shift))
