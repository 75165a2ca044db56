"""Motions in time: from a file's frames to the paper's 60 fps, y up (Section 3.2).

Of a file at a lower rate than the result, straight lines would be corners at which the tissue is
hit: splines go through those frames. Nothing is extrapolated beyond the last frame, and nothing is
interpolated across a cut (`bridge.motion.cuts`). Axis-angle vectors are kept continuous in time, as
those of an alignment that starts each frame from the one before.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion.cuts import find_cuts
from bridge.motion.interpolation import curved, straight, values_on_lines
from bridge.motion.motion import (
    AS_IT_SAYS,
    MOST_FRAMES,
    RATES_HZ,
    Y_UP_FROM_Z_UP,
    HowRead,
    Motion,
    SmoothHz,
)
from bridge.motion.readers import read_motion_file
from bridge.motion.repairs import without_gaps, without_repeats, without_spikes
from bridge.motion.smoothing import continuous_rotations, smoothed
from bridge.paper import FPS

# Files store rates such as 120.00004577636719; a last frame must not be lost to that.
_FRAME_TOLERANCE = 1e-3
_FEWEST_OF_SPLINE = 4


def load_motion(
    path: Path | str,
    source_fps: float | None = None,
    fps: float = FPS,
    smooth_hz: SmoothHz | None = None,
    how: HowRead = AS_IT_SAYS,
) -> Motion:
    """Read any motion that can be followed, y up: a file of `bridge.motion.readers`, or a sample.

    `DsnetError` if the file is missing, is none of these, or holds no usable motion, or a rate
    is none.

    Parameters
    ----------
    source_fps : frames per second of the file, where what it says of itself is wrong.
    fps : frames per second of the result (Table 1: from 100 to 60).
    smooth_hz : leave out what is faster (`bridge.motion.smoothing`), at a cutoff or `auto`, at the
        one that suits each moment; None: nothing.
    how : what else the user says of the file.
    """
    how = how if source_fps is None else replace(how, fps=source_fps)
    return prepared(read_motion_file(Path(path), how), source_fps, fps, smooth_hz)


def prepared(
    motion: Motion,
    source_fps: float | None = None,
    fps: float = FPS,
    smooth_hz: SmoothHz | None = None,
) -> Motion:
    """A motion as its file has it at another rate, y up, without what is no motion; the arguments
    are those of `load_motion`."""
    if not (np.isfinite(fps) and fps > 0):
        raise DsnetError(f"fps={fps}", "a positive number", "Pass 60, the paper's rate.")
    if source_fps is not None:
        lowest, highest = RATES_HZ
        if not lowest <= source_fps <= highest:
            raise DsnetError(
                f"a motion at {source_fps:g} frames a second",
                f"{lowest:g} to {highest:g}",
                "Pass the rate that it was recorded at.",
            )
        motion = replace(motion, fps=source_fps, source_fps=source_fps)
    if np.isnan(motion.fps):
        raise DsnetError(
            f"{motion.source}, which does not say its rate, or says two",
            "how many frames a second it has",
            "Pass --motion-fps N (--amass-fps N of a folder, source_fps=N in Python).",
        )
    motion = without_spikes(without_repeats(without_gaps(motion)))
    if smooth_hz is not None:
        motion = smoothed(motion, smooth_hz)
    count = len(motion.theta)
    if (frames := resampled_frames(count, motion.fps, fps)) > MOST_FRAMES:
        raise DsnetError(
            f"{motion.source}, {count} frames at {motion.fps:g} Hz: {frames} at {fps:g}",
            f"at most {MOST_FRAMES}",
            "Check its rate, or cut it into several files.",
        )
    motion = _resampled(motion, fps)
    pose, trans_m = motion.all_joints, motion.trans_m
    if motion.up == "z":
        pose[:, 0] = (Y_UP_FROM_Z_UP * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
        trans_m = Y_UP_FROM_Z_UP.apply(trans_m)
    # Where frames are left out, steps add up: there may be more cuts than in the file.
    cuts = tuple(sorted({*motion.cuts, *find_cuts(motion.theta)}))
    for first, last in pairwise([0, *cuts, len(pose)]):
        pose[first:last] = continuous_rotations(pose[first:last])
    return motion.posed(pose, trans_m, up="y", cuts=cuts)


def resampled_frames(frame_count: int, source_fps: float, fps: float = FPS) -> int:
    """How many frames a motion of `frame_count` frames has at `fps`."""
    duration_s = (frame_count - 1) / source_fps
    return int(np.floor(duration_s * fps + _FRAME_TOLERANCE)) + 1


def _resampled(motion: Motion, fps: float) -> Motion:
    """The motion at `fps`, piece by piece between cuts.

    What is sampled between the last frame before a cut and the first after it goes on as the
    motion did before. A cut stays where both of its sides are sampled.
    """
    whole, line = motion.all_joints, values_on_lines(motion)
    count = len(whole)
    times_s = np.arange(resampled_frames(count, motion.fps, fps)) / fps
    times_s = np.minimum(times_s, (count - 1) / motion.fps)
    first_times_s = np.array([0, *motion.cuts]) / motion.fps
    first_samples = np.searchsorted(times_s, first_times_s - _FRAME_TOLERANCE / fps)
    each = zip(motion.pieces, pairwise([*first_samples.tolist(), len(times_s)]), strict=True)
    sampled = [(piece, one, last) for piece, (one, last) in each if one < last]
    cuts = tuple(two[1] for one, two in pairwise(sampled) if one[0].stop == two[0].start)
    parts = []
    for piece, one, last in sampled:
        pose, values = whole[piece], line[piece]
        if piece.stop < count:
            before, now = (Rotation.from_rotvec(pose[i]) for i in (max(len(pose) - 2, 0), -1))
            pose = np.concatenate([pose, (now * before.inv() * now).as_rotvec()[None]])
            values = np.concatenate([values, 2 * values[-1:] - values[-2:][:1]])
        source_s = np.arange(len(pose)) / motion.fps
        at_s = np.clip(times_s[one:last] - piece.start / motion.fps, 0, source_s[-1])
        is_slow = motion.fps < fps - _FRAME_TOLERANCE and len(pose) >= _FEWEST_OF_SPLINE
        parts.append((curved if is_slow else straight)(pose, values, source_s, at_s))
    pose, moved = (np.concatenate(each) for each in zip(*parts, strict=True))
    dmpls = None if motion.dmpls is None else moved[:, 3:]
    return motion.posed(pose, moved[:, :3], dmpls=dmpls, fps=float(fps), cuts=cuts)
