"""Motions from AMASS and BVH files, as the paper prepares them (Section 3.2): 60 fps, y up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from bridge.errors import DsnetError
from bridge.motion.amass_file import StoredMotion, read_amass_file
from bridge.motion.bounds import MOST_FRAMES, RATES_HZ
from bridge.motion.cuts import find_cuts
from bridge.motion.motion import DEFAULT_FPS, Y_UP_FROM_Z_UP, Motion, UpAxis
from bridge.motion.motion_file import read_motion_file
from bridge.motion.smoothing import SmoothHz, smoothed
from bridge.motion.theta import pack_theta

# Files store rates such as 120.00004577636719; a last frame must not be lost to that.
_FRAME_TOLERANCE = 1e-3


def load_amass_motion(
    path: Path | str,
    *,
    root_joint_m: ArrayLike | None = None,
    fps: float = DEFAULT_FPS,
    source_fps: float | None = None,
    up: UpAxis = "y",
) -> Motion:
    """Read an AMASS `.npz` (SMPL-H or SMPL-X), resample it and turn it upright.

    Rotations are interpolated on the sphere (SLERP, the short way) joint by joint, translation
    and DMPL coefficients linearly; nothing is extrapolated beyond the last frame, and nothing is
    interpolated across a cut (`bridge.motion.cuts`). Axis-angle vectors are kept continuous in
    time, as those of an alignment that starts each frame from the one before.

    Parameters
    ----------
    path : the file; `bridge.motion.amass_file` says what it must hold.
    root_joint_m : (3,) rest position of the root joint of the body that will be posed, metres;
        0 when None. It can be given later: `Motion.about_root_joint`.
    fps : frames per second of the result (Table 1: from 100 to 60).
    source_fps : frames per second of the file, where what it says of itself is wrong.
    up : vertical axis of the result; AMASS has z.

    Raises
    ------
    DsnetError
        If the file is missing, is not such an archive, or holds no usable motion, or a rate is
        none.
    """
    motion = _prepared(Path(path), read_amass_file, fps, source_fps, up)
    return motion if root_joint_m is None else motion.about_root_joint(root_joint_m)


def load_motion_file(
    path: Path | str,
    source_fps: float | None = None,
    fps: float = DEFAULT_FPS,
    smooth_hz: SmoothHz | None = None,
) -> Motion:
    """Read any motion that can be followed, y up: AMASS `.npz`, a sample, or BVH.

    A BVH skeleton is brought to SMPL's joints (`bridge.motion.retargeting`); it has no shape.

    Parameters
    ----------
    source_fps : frames per second of the file, where what it says of itself is wrong.
    fps : frames per second of the result.
    smooth_hz : leave out what is faster (`bridge.motion.smoothing`), at a cutoff or `auto`, at the
        one that suits each moment; None: nothing.

    Raises
    ------
    DsnetError
        If the file is missing, is none of these, or holds no usable motion, or the rate is none.
    """
    return _prepared(Path(path), read_motion_file, fps, source_fps, smooth_hz=smooth_hz)


def _prepared(
    path: Path,
    read: Callable[[Path], StoredMotion],
    fps: float = DEFAULT_FPS,
    source_fps: float | None = None,
    up: UpAxis = "y",
    smooth_hz: SmoothHz | None = None,
) -> Motion:
    """Smoothed, resampled and turned upright; see `load_amass_motion`."""
    if not (np.isfinite(fps) and fps > 0):
        raise DsnetError(f"fps={fps}", "a positive number", "Pass 60, the paper's rate.")
    stored = read(path)
    if source_fps is not None:
        stored = replace(stored, fps=_checked_rate(source_fps))
    if smooth_hz is not None:
        stored = smoothed(stored, smooth_hz)
    if (frames := resampled_frames(len(stored.pose), stored.fps, fps)) > MOST_FRAMES:
        raise DsnetError(
            f"{path}, {len(stored.pose)} frames at {stored.fps:g} Hz: {frames} at {fps:g}",
            f"at most {MOST_FRAMES}",
            "Check its rate, or cut it into several files.",
        )
    pose, trans_m, dmpls = _resample(stored, fps)
    if up == "y":
        pose[:, 0] = (Y_UP_FROM_Z_UP * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
        trans_m = Y_UP_FROM_Z_UP.apply(trans_m)
    for first, end in pairwise([0, *find_cuts(pose, trans_m), len(pose)]):
        pose[first:end] = continuous_rotations(pose[first:end])
    return Motion(
        theta=pack_theta(pose, trans_m),
        betas=stored.betas,
        gender=stored.gender,
        fps=float(fps),
        source_fps=stored.fps,
        source=path,
        up=up,
        dmpls=dmpls,
        lead_in=stored.lead_in,
        smooth_hz=smooth_hz,
    )


def _checked_rate(source_fps: float) -> float:
    lowest, highest = RATES_HZ
    if not lowest <= source_fps <= highest:
        raise DsnetError(
            f"a motion at {source_fps:g} frames a second",
            f"{lowest:g} to {highest:g}",
            "Pass the rate that it was recorded at.",
        )
    return source_fps


def resampled_frames(frame_count: int, source_fps: float, fps: float = DEFAULT_FPS) -> int:
    """How many frames a motion of `frame_count` frames has at `fps`."""
    duration_s = (frame_count - 1) / source_fps
    return int(np.floor(duration_s * fps + _FRAME_TOLERANCE)) + 1


def _resample(
    stored: StoredMotion, fps: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]:
    """Joint rotations, translation and DMPL coefficients at `fps`, piece by piece between cuts."""
    times_s = _sample_times_s(len(stored.pose), stored.fps, fps)
    starts = [0, *find_cuts(stored.pose, stored.trans_m)]
    first_times_s = np.array(starts) / stored.fps - _FRAME_TOLERANCE / fps
    samples = [*np.searchsorted(times_s, first_times_s), len(times_s)]
    found = []
    for (first, end), (one, last) in zip(
        pairwise([*starts, len(stored.pose)]), pairwise(samples), strict=True
    ):
        goes_on = end < len(stored.pose)
        pose = _and_next_rotation(stored.pose[first:end], goes_on)
        rows = [stored.trans_m, *([] if stored.dmpls is None else [stored.dmpls])]
        lines = [_and_next_value(values[first:end], goes_on) for values in rows]
        at_s = np.clip(times_s[one:last] - first / stored.fps, 0, (len(pose) - 1) / stored.fps)
        if len(at_s):
            moved = [_resample_linearly(values, stored.fps, at_s) for values in lines]
            found.append([_resample_rotations(pose, stored.fps, at_s), *moved])
    pose, trans_m, *dmpls = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return pose, trans_m, dmpls[0] if dmpls else None


def _and_next_rotation(pose: NDArray[np.float64], goes_on: bool) -> NDArray[np.float64]:
    """Rotations (T, 22, 3), and before a cut one more, as if the motion went on as it did.

    Samples between the last frame before a cut and the first after it lie there.
    """
    if not goes_on:
        return pose
    before, last = (Rotation.from_rotvec(pose[i]) for i in (max(len(pose) - 2, 0), -1))
    return np.concatenate([pose, (last * before.inv() * last).as_rotvec()[None]])


def _and_next_value(values: NDArray[np.float64], goes_on: bool) -> NDArray[np.float64]:
    """The same for what is interpolated linearly (T, N)."""
    if not goes_on:
        return values
    return np.concatenate([values, 2 * values[-1:] - values[-2:][:1]])


def _sample_times_s(frame_count: int, source_fps: float, fps: float) -> NDArray[np.float64]:
    duration_s = (frame_count - 1) / source_fps
    return np.minimum(np.arange(resampled_frames(frame_count, source_fps, fps)) / fps, duration_s)


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
