"""Motions from AMASS files, as the paper prepares them (Section 3.2): 60 fps, y up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.errors import DsnetError
from bridge.motion.amass_file import read_amass_file
from bridge.motion.theta import pack_theta, unpack_theta

UpAxis = Literal["y", "z"]
_R_YUP_ZUP = Rotation.from_euler("x", -90, degrees=True)
# Files store rates such as 120.00004577636719; a last frame must not be lost to that.
_FRAME_TOLERANCE = 1e-3


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
        shift = _R_YUP_ZUP.apply(joint) - joint
        return replace(self, theta=pack_theta(pose, trans + shift))


def load_amass_motion(
    path: Path | str,
    *,
    root_joint_m: ArrayLike | None = None,
    fps: float = 60.0,
    up: UpAxis = "y",
) -> Motion:
    """Read an AMASS `.npz` (SMPL-H or SMPL-X), resample it and turn it upright.

    Rotations are interpolated on the sphere (SLERP, the short way) joint by joint, translation
    and DMPL coefficients linearly; nothing is extrapolated beyond the last frame. Axis-angle
    vectors are kept continuous in time, as those of an alignment that starts each frame from
    the one before.

    Parameters
    ----------
    path : the file; `bridge.motion.amass_file` says what it must hold.
    root_joint_m : (3,) rest position of the root joint of the body that will be posed, metres;
        0 when None. It can be given later: `Motion.about_root_joint`.
    fps : frames per second of the result (Table 1: from 100 to 60).
    up : vertical axis of the result; AMASS has z.

    Raises
    ------
    DsnetError
        If the file is missing, is not such an archive, or holds no usable motion.
    """
    path = Path(path)
    if not (np.isfinite(fps) and fps > 0):
        raise DsnetError(f"fps={fps}", "a positive number", "Pass 60, the paper's rate.")
    stored = read_amass_file(path)
    times_s = _sample_times_s(len(stored.pose), stored.fps, fps)
    pose = _resample_rotations(stored.pose, stored.fps, times_s)
    trans_m = _resample_linearly(stored.trans_m, stored.fps, times_s)
    if up == "y":
        pose[:, 0] = (_R_YUP_ZUP * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
        trans_m = _R_YUP_ZUP.apply(trans_m)
    dmpls = stored.dmpls
    motion = Motion(
        theta=pack_theta(continuous_rotations(pose), trans_m),
        betas=stored.betas,
        gender=stored.gender,
        fps=float(fps),
        source_fps=stored.fps,
        source=path,
        up=up,
        dmpls=None if dmpls is None else _resample_linearly(dmpls, stored.fps, times_s),
    )
    return motion if root_joint_m is None else motion.about_root_joint(root_joint_m)


def _sample_times_s(frame_count: int, source_fps: float, fps: float) -> NDArray[np.float64]:
    duration_s = (frame_count - 1) / source_fps
    count = int(np.floor(duration_s * fps + _FRAME_TOLERANCE)) + 1
    return np.minimum(np.arange(count) / fps, duration_s)


def _resample_rotations(
    pose: NDArray[np.float64], source_fps: float, times_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    if len(pose) == 1:
        return pose.copy()
    source_s = np.arange(len(pose)) / source_fps
    joints = [Slerp(source_s, Rotation.from_rotvec(joint)) for joint in pose.swapaxes(0, 1)]
    return np.stack([slerp(times_s).as_rotvec() for slerp in joints], axis=1)


def _resample_linearly(
    values: NDArray[np.float64], source_fps: float, times_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    source_s = np.arange(len(values)) / source_fps
    return np.stack([np.interp(times_s, source_s, column) for column in values.T], axis=1)


def continuous_rotations(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the axis-angle vectors (T, J, 3) of each rotation, the one nearest to the frame before."""
    angle = np.linalg.norm(pose, axis=-1, keepdims=True)
    axis = np.divide(pose, angle, out=np.zeros_like(pose), where=angle > 1e-9)
    result = pose.copy()
    for frame in range(1, len(pose)):
        along = (result[frame - 1] * axis[frame]).sum(axis=-1, keepdims=True)
        turns = np.round((along - angle[frame]) / (2 * np.pi))
        result[frame] += 2 * np.pi * turns * axis[frame]
    return result
