"""Motions from AMASS files, as the paper prepares them (Section 3.2): 60 fps, y up.

AMASS stores SMPL-H (`poses` 156 wide) or SMPL-X (`stageii` files, 165 wide) parameters with z
up, at the rate of the original capture. Both begin with the root's rotation and the 21 body
joints, which are the 22 joints of the paper's pose vector.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.errors import DsnetError
from bridge.exchange.poses import N_BETAS, N_JOINTS, pack_theta, unpack_theta

UpAxis = Literal["y", "z"]
_POSE_WIDTHS = {72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
_RATE_KEYS = ("mocap_framerate", "mocap_frame_rate")
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
    path : the file; `poses`, `trans`, `betas` and `mocap_framerate` (or `mocap_frame_rate`).
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
    arrays = _read_archive(path)
    pose, trans = _read_pose(path, arrays)
    source_fps = _read_rate(path, arrays)
    times_s = _sample_times_s(len(pose), source_fps, fps)
    pose = _resample_rotations(pose, source_fps, times_s)
    trans = _resample_linearly(trans, source_fps, times_s)
    if up == "y":
        pose[:, 0] = (_R_YUP_ZUP * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
        trans = _R_YUP_ZUP.apply(trans)
    dmpls = (
        _read_numbers(path, arrays, "dmpls", len(arrays["poses"])) if "dmpls" in arrays else None
    )
    motion = Motion(
        theta=pack_theta(_continuous(pose), trans),
        betas=_read_betas(path, arrays),
        gender=_read_gender(arrays),
        fps=float(fps),
        source_fps=source_fps,
        source=path,
        up=up,
        dmpls=None if dmpls is None else _resample_linearly(dmpls, source_fps, times_s),
    )
    return motion if root_joint_m is None else motion.about_root_joint(root_joint_m)


def _read_archive(path: Path) -> dict[str, NDArray]:
    """The arrays that matter; a file has others (markers), which may be large or pickled."""
    wanted = {"poses", "trans", "betas", "gender", "dmpls", *_RATE_KEYS}
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return {key: archive[key] for key in wanted & set(archive.files)}
    except FileNotFoundError as error:
        raise _unusable(path, "which does not exist", "Check the path.") from error
    except IsADirectoryError as error:
        raise _unusable(path, "which is a folder", "Name one file in it.") from error
    except (OSError, EOFError, ValueError, AttributeError, TypeError) as error:
        raise _unusable(path, f"which does not load ({error})") from error
    except (zipfile.BadZipFile, zlib.error) as error:
        raise _unusable(path, f"which is damaged ({error})") from error


def _unusable(path: Path, flaw: str, remedy: str = "Download the file again.") -> DsnetError:
    return DsnetError(f"{path}, {flaw}", "an AMASS motion file (.npz) without pickles", remedy)


def _read_numbers(
    path: Path, arrays: Mapping[str, NDArray], key: str, frame_count: int | None = None
) -> NDArray[np.float64]:
    if key not in arrays:
        raise _unusable(
            path, f"which has no {key!r}", "Pass a motion, not a shape or a model file."
        )
    array = arrays[key]
    if not np.issubdtype(array.dtype, np.number) or not np.isfinite(array).all():
        raise _unusable(path, f"whose {key!r} are not all finite numbers")
    if frame_count is not None and (array.ndim != 2 or len(array) != frame_count):
        raise _unusable(
            path, f"whose {key!r} have shape {array.shape} beside {frame_count} frames of poses"
        )
    return array.astype(np.float64)


def _read_pose(
    path: Path, arrays: Mapping[str, NDArray]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Joint rotations (T, 22, 3) and translations (T, 3)."""
    poses = _read_numbers(path, arrays, "poses")
    if poses.ndim != 2 or poses.shape[1] not in _POSE_WIDTHS:
        known = ", ".join(f"{width} ({model})" for width, model in _POSE_WIDTHS.items())
        raise DsnetError(
            f"{path}, whose 'poses' have shape {poses.shape}",
            f"(frames, width) with a width of {known}",
            "Pass a file of AMASS's SMPL-H or SMPL-X release.",
        )
    if not len(poses):
        raise _unusable(path, "which has zero frames", "Pass a motion with at least one frame.")
    trans = _read_numbers(path, arrays, "trans", len(poses))
    if trans.shape[1] != 3:
        raise _unusable(path, f"whose 'trans' have shape {trans.shape}")
    return poses[:, : 3 * N_JOINTS].reshape(-1, N_JOINTS, 3), trans


def _read_rate(path: Path, arrays: Mapping[str, NDArray]) -> float:
    key = next((key for key in _RATE_KEYS if key in arrays), None)
    if key is None:
        raise _unusable(path, f"which has neither {' nor '.join(_RATE_KEYS)}", "Add its rate, Hz.")
    rate = _read_numbers(path, arrays, key)
    if rate.size != 1 or rate.item() <= 0:
        raise _unusable(path, f"whose {key} is {rate.tolist()}", "Write its rate, Hz.")
    return rate.item()


def _read_betas(path: Path, arrays: Mapping[str, NDArray]) -> NDArray[np.float64]:
    betas = _read_numbers(path, arrays, "betas")
    if betas.size < N_BETAS or betas.size != betas.shape[-1]:
        raise _unusable(
            path,
            f"whose 'betas' have shape {betas.shape}",
            f"Store one vector of {N_BETAS} or more coefficients.",
        )
    return betas.ravel()[:N_BETAS]


def _read_gender(arrays: Mapping[str, NDArray]) -> str:
    stored = arrays.get("gender", np.array("unknown"))
    value = stored.item() if stored.size == 1 else "unknown"
    text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
    gender = text.strip().lower()
    return gender if gender in ("female", "male", "neutral") else "unknown"


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


def _continuous(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the axis-angle vectors of each rotation, the one nearest to the frame before."""
    angle = np.linalg.norm(pose, axis=-1, keepdims=True)
    axis = np.divide(pose, angle, out=np.zeros_like(pose), where=angle > 1e-9)
    result = pose.copy()
    for frame in range(1, len(pose)):
        along = (result[frame - 1] * axis[frame]).sum(axis=-1, keepdims=True)
        turns = np.round((along - angle[frame]) / (2 * np.pi))
        result[frame] += 2 * np.pi * turns * axis[frame]
    return result
