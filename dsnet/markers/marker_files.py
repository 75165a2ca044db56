"""Optical markers of any file that is read: named alike, in metres, y up, gaps as NaN."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.markers import MarkerFile, marker_file_refused, refused
from bridge.motion.motion import AS_IT_SAYS, Y_UP_FROM_Z_UP, HowRead
from bridge.motion.readers import format_of, read_motion_file
from bridge.motion.readers.amass import motion_path
from bridge.motion.readers.markers import markers_beside_poses
from bridge.motion.readers.recordings import (
    is_recording,
    poses_beside,
    recording,
    recording_beside,
)
from bridge.paper import N_VERTICES
from bridge.runs.untrusted import open_npz
from dsnet.markers.places import SAME_PLACE
from dsnet.markers.segments import SEEN_ENOUGH, SEGMENTS, Cloud, bridged

_SAME_LENGTH_S = 0.03
"""A motion at 60 fps is shorter than its file by less than that."""
_PERSON_M = (0.8, 3.5)
"""How much room markers of a person take up at any moment, largest extent."""
_PADDED_FRAMES = 15
_FEWEST_HELD, _MOST_REPEATED = 4, 0.3
"""Markers that stay where they were in a frame that is repeated, and the part of a recording that
such frames may be to be left out."""
_MOVED_ON_M = 5e-4
"""What most markers move after frames that are repeated: less is a person who stands still, in a
file of few digits."""
_RATE = "Pass --motion-fps N"
_ABOVE = (SEGMENTS["head"].labels, SEGMENTS["thorax"].labels, SEGMENTS["pelvis"].labels)
"""Groups of markers, the first of which that is there is looked for above the feet."""
_ON_FEET = ("LANK", "RANK", "LHEE", "RHEE", "LTOE", "RTOE")


@dataclass(frozen=True, eq=False)
class Markers:
    """Labelled points over time."""

    points_m: NDArray[np.float64]
    """(T, N, 3) metres, y up; NaN where a marker was not seen."""
    labels: tuple[str, ...]
    fps: float
    note: str = ""
    """What was done to the file's numbers; empty if nothing."""
    vertices: Mapping[str, int] = field(default_factory=dict)
    """Of SMPL, by label, where the file says them."""

    def at(self, fps: float, frame_count: int) -> Cloud:
        """The markers that are seen often enough, at another rate and of a given length."""
        points, seen = {}, {}
        for index, label in enumerate(self.labels):
            there = np.asarray(np.isfinite(self.points_m[:, index]).all(axis=1))
            if label not in points and there.mean() > SEEN_ENOUGH:
                whole = bridged(self.points_m[:, index], there)
                points[label] = _resampled(whole, self.fps, fps, frame_count)
                times = np.arange(frame_count) * (self.fps / fps)
                seen[label] = np.interp(times, np.arange(len(there)), there, right=0) > 0.99
        return Cloud(points, seen)


def load_recording(
    path: Path, source_fps: float | None = None, how: HowRead = AS_IT_SAYS
) -> Motion:
    """The motion whose pose was fitted to a file's markers, with those markers: of an AMASS `.npz`,
    a MoSh++ `*_stageii.pkl`, or a recording with the
    pose beside it; parameters are `load_motion`'s."""
    motion = load_motion(pose_file(path), source_fps, how=how)
    return replace(motion, markers=recording(path)) if is_recording(path) else motion


def markers_of(motion: Motion) -> Markers:
    """The markers of a motion, checked; at its rate, where they last as long, whatever their
    file says.

    `DsnetError` if it has none, their file is damaged, or they have no names or are not of one
    person's size.
    """
    if motion.markers is None:
        raise refused(
            motion.source,
            "a file without 'marker_data' and 'marker_labels'",
            "markers (T, N, 3) and their names (N,), or a .c3d of the same name beside it",
            "AMASS's SMPL-H release has them; the SMPL-X release does not",
        )
    stored, fps = motion.markers.stored, motion.source_fps
    is_as_long = abs((len(stored.points) - 1) / fps - motion.duration_s) < _SAME_LENGTH_S
    return checked_markers(motion.markers, fps if is_as_long else stored.fps or fps)


def checked_markers(file: MarkerFile, fps: float | None = None) -> Markers:
    """The markers of a file, at the rate `fps`, or at that of the file; `DsnetError` as
    `markers_of`, also if neither says a rate."""
    path, stored = file.path, file.stored
    data = np.array(stored.points, np.float64) if stored.points.dtype.kind in "iuf" else None
    if data is None or data.shape != (len(data), len(stored.labels), 3) or not stored.labels:
        raise refused(
            path,
            f"markers of {stored.points.dtype} in shape {stored.points.shape} with "
            f"{len(stored.labels)} names",
            "numbers (T, N, 3) with N names",
        )
    whose, names = _names(path, stored.labels)
    data[~data.any(axis=2)] = np.nan  # some files write a marker that was not seen as zeros
    if not (np.isfinite(data).all(axis=2).mean(axis=0) > SEEN_ENOUGH).any():
        raise refused(path, "markers that are hardly ever seen", "most of them in most frames")
    data, note = _in_metres(path, data, stored.per_m)
    data, repeats = _without_repeats(data)
    up = Y_UP_FROM_Z_UP if stored.upright else _upright(data, names)
    upright = up.apply(data.reshape(-1, 3)).reshape(data.shape)
    if (fps := fps or stored.fps) is None:
        raise refused(path, "without a frame rate", "how many frames a second it has", _RATE)
    vertices = {whose[label]: v for label, v in stored.vertices.items() if label in whose}
    return Markers(
        upright,
        names,
        fps,
        "; ".join(filter(None, (note, repeats))),
        {name: v for name, v in vertices.items() if type(v) is int and 0 <= v < N_VERTICES},
    )


def pose_file(path: Path) -> Path:
    """The file of the pose that was fitted to a file's markers: itself, or beside a
    recording."""
    if not is_recording(path):
        return motion_path(path)
    there = poses_beside(path)
    pose = next((pose for pose in there if pose.is_file()), None)
    if pose is None:
        raise DsnetError(
            f"{path}, markers without a pose",
            f"{there[0].name} (or {', '.join(pose.name for pose in there[1:])}) beside it",
            "Put the AMASS or MoSh++ file of the same take there, under that name.",
        )
    return pose


def is_lone(path: Path) -> bool:
    """Whether a file is a recording of markers without a pose beside it."""
    return is_recording(path) and not any(pose.is_file() for pose in poses_beside(path))


def lone_files(folder: Path) -> list[Path]:
    """Recordings below a folder that have no pose beside them."""
    return sorted(path for path in folder.rglob("*") if is_lone(path))


def marker_file(path: Path) -> Path | None:
    """The file of the markers that a motion file's pose was fitted to, if there is one."""
    if not path.is_file():
        return None
    with marker_file_refused(path):
        if is_recording(path) or format_of(path) == "moshpp":
            return path
        if format_of(path) == "video":
            markers = read_motion_file(path).markers
            return markers and markers.path
        if path.suffix == ".npz":
            with open_npz(path) as archive:
                markers = markers_beside_poses(archive, path)
            return markers and markers.path
    return recording_beside(path)


def _names(path: Path, labels: list[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """The markers' names as this package has them, by those of the file."""
    if len({label for label in labels if label.strip("*0123456789 ")}) < 4:
        raise refused(
            path,
            f"markers without names ({', '.join(labels[:3])}, ...)",
            "names such as C7, CLAV, LBUST",
            "Label them, as MoSh++ and AMASS do",
        )
    plain = [label.rpartition(":")[2].strip().upper().replace("_", "") for label in labels]
    names = tuple(SAME_PLACE.get(name, name) for name in plain)
    usual = {label for segment in SEGMENTS.values() for label in segment.labels}
    named = zip(labels, names, strict=True)
    people = Counter(label.rpartition(":")[0] for label, name in named if name in usual)
    crowd = [name or "somebody else" for name, count in people.items() if count >= 4]
    if len(crowd) > 1:
        raise refused(path, f"markers of {' and '.join(crowd[:3])}", "those of one person")
    return dict(zip(labels, names, strict=True)), names


def _upright(data_m: NDArray, names: Sequence[str]) -> Rotation:
    """To y up, from whatever axis people's heads are above their feet along."""
    places = [[n for n, name in enumerate(names) if name in each] for each in (*_ABOVE, _ON_FEET)]
    above = next((each for each in places[:-1] if each), [])
    if not above or not places[-1]:
        return Y_UP_FROM_Z_UP
    head, foot = (np.nanmedian(data_m[:, end], axis=(0, 1)) for end in (above, places[-1]))
    axis = int(np.abs(head - foot).argmax())
    up = np.sign(head - foot)[axis] * np.eye(3)[axis]
    turned, _ = Rotation.align_vectors(np.array([[0.0, 1.0, 0.0]]), up[None])
    return turned


def _without_repeats(data_m: NDArray) -> tuple[NDArray[np.float64], str]:
    """Places that are NaN in frames in which all markers stay where they were, to the last digit,
    until they move on; and a note of these. A recording of which they are a large part stays as it
    is."""
    there = np.asarray(np.isfinite(data_m).all(axis=2))
    both = there[1:] & there[:-1]
    held = (np.diff(data_m, axis=0) == 0).all(axis=2)
    repeated = np.r_[False, (held == both).all(axis=1) & (both.sum(axis=1) >= _FEWEST_HELD)]
    steps_m = np.ma.masked_invalid(np.linalg.norm(np.diff(data_m, axis=0), axis=2))
    step_m = np.ma.median(steps_m, axis=1).filled(0.0)
    for last in np.flatnonzero(repeated[:-1] & ~repeated[1:]):
        if step_m[last] < _MOVED_ON_M:
            first = last - int(np.argmin(repeated[last::-1])) + 1
            repeated[first : last + 1] = False
    if not repeated.any():
        return data_m, ""
    counted = f"{repeated.sum()} of {len(repeated)} frames of its markers repeat the one before"
    if repeated.mean() > _MOST_REPEATED:
        return data_m, f"{counted}: they were recorded at another rate, or stand still"
    first = int(np.argmax(repeated))
    kept_m = np.where(repeated[:, None, None], np.nan, data_m)
    return kept_m, f"{counted}, first frame {first}: they are left out"


def _in_metres(path: Path, data: NDArray, per_m: float | None) -> tuple[NDArray[np.float64], str]:
    """Metres, by what the file says, else by the room that the markers of a moment take up."""
    seen = np.asarray(np.isfinite(data).all(axis=2))
    some = data[seen.any(axis=1)]
    extent = float(np.median(np.nanmax(some, axis=1) - np.nanmin(some, axis=1), axis=0).max())
    units = {"metres": 1.0, "millimetres": 1e3, "centimetres": 1e2}
    for unit, each in units.items() if per_m is None else [("", per_m)]:
        if _PERSON_M[0] <= extent / each <= _PERSON_M[1]:
            stated = each == 1 or per_m is not None
            return data / each, "" if stated else f"its markers are in {unit}: converted"
    raise refused(path, f"markers {extent:.3g} apart", "those of a person, in metres")


def _resampled(points: NDArray, fps: float, to_fps: float, count: int) -> NDArray[np.float64]:
    if len(points) == count and abs(fps - to_fps) < 0.01:
        return points
    if len(points) == 1:
        return points.repeat(count, axis=0)
    # Every prediction imports this module, and few have markers: these load slowly.
    from scipy.interpolate import CubicSpline
    from scipy.signal import butter, sosfiltfilt

    if fps > 1.5 * to_fps:  # what is faster than the new rate can hold would fold back
        low = butter(4, 0.45 * to_fps, fs=fps, output="sos")
        padded = min(_PADDED_FRAMES, len(points) - 1)
        points = np.asarray(sosfiltfilt(low, points, axis=0, padlen=padded), np.float64)
    at_s = np.minimum(np.arange(count) / to_fps, (len(points) - 1) / fps)
    return np.asarray(CubicSpline(np.arange(len(points)) / fps, points)(at_s), np.float64)
