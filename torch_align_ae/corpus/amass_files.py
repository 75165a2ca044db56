"""Motions written as AMASS stores them: SMPL-H parameters, z up, gender as bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion import unpack_theta
from bridge.paper import N_JOINTS

_AMASS_POSE_WIDTH = 156
_AMASS_BETA_COUNT = 16
_R_ZUP_YUP = Rotation.from_euler("x", 90, degrees=True)


def write_amass_motion(
    path: Path,
    theta: NDArray[np.float64],
    *,
    betas: NDArray[np.float64],
    gender: str,
    fps: float,
    root_joint_m: NDArray[np.float64],
    source: str = "synthetic",
) -> None:
    """Write theta (T, 69), y up, as an AMASS `.npz` with z up.

    Parameters
    ----------
    betas : (10,) shape of the subject.
    fps : frames per second of `theta`.
    root_joint_m : (3,) rest position of the subject's root joint, about which SMPL turns:
        turning the world z up turns root_joint + trans, not trans.
    source : what the file says of its origin.
    """
    pose, trans = unpack_theta(theta)
    poses = np.zeros((len(theta), _AMASS_POSE_WIDTH))
    poses[:, : 3 * N_JOINTS] = pose.reshape(len(theta), -1)
    poses[:, :3] = (_R_ZUP_YUP * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    padded_betas = np.zeros(_AMASS_BETA_COUNT)
    padded_betas[: len(betas)] = betas
    np.savez(
        path,
        poses=poses,
        trans=_R_ZUP_YUP.apply(root_joint_m + trans) - root_joint_m,
        betas=padded_betas,
        gender=np.array(gender.encode()),
        mocap_framerate=np.array(fps),
        dmpls=np.zeros((len(theta), 8)),
        source=np.array(source),
    )
