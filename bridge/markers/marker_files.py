"""Optical markers of an AMASS `.npz` of the SMPL-H release, which keeps `marker_data` (T, N, 3)
and `marker_labels` (N,) beside the pose that was fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from bridge.errors import DsnetError
from bridge.markers.segments import SEEN_ENOUGH, Cloud, bridged
from bridge.motion.motion import MOST_FRAMES, Y_UP_FROM_Z_UP
from bridge.runs.untrusted import damage_refused, open_npz

_MOST_MARKERS = 500
_MOST_BYTES = MOST_FRAMES * _MOST_MARKERS * 3 * 8
_PERSON_M = (0.8, 3.5)
"""How much room markers of a person take up at any moment, largest extent."""
_SAME_PLACE = {
    "TOPBACK": "C7",
    "MIDBACK": "T10",
    "R10": "RBAK",
    "LFSH": "LSHO",
    "RFSH": "RSHO",
    **{
        f"{side}{name}": side + other
        for side in "LR"
        for name, other in (("HIP", "THI"), ("LEG", "TIB"), ("SHIN", "TIB"))
    },
}
"""Other names of the same places, in the marker sets of AMASS's sources."""


@dataclass(frozen=True, eq=False)
class Markers:
    """Labelled points over time."""

    points_m: NDArray[np.float64]
    """(T, N, 3) metres, y up; NaN where a marker was not seen."""
    labels: tuple[str, ...]
    fps: float
    note: str = ""
    """What was done to the file's numbers; empty if nothing."""

    def at(self, fps: float, frame_count: int) -> Cloud:
        """The markers that are seen often enough, at another rate and of a given length."""
        points, seen = {}, {}
        for index, label in enumerate(self.labels):
            there = np.asarray(np.isfinite(self.points_m[:, index]).all(axis=1))
            if label not in points and there.mean() > SEEN_ENOUGH:
                whole = bridged(self.points_m[:, index], there)
                points[label] = _resampled(whole, self.fps, fps, frame_count)
                times = np.arange(frame_count) / fps * self.fps
                seen[label] = np.interp(times, np.arange(len(there)), there) > 0.99
        return Cloud(points, seen)


def read_markers(path: Path, fps: float) -> Markers:
    """The markers of a file.

    Parameters
    ----------
    fps : frames per second: that of the pose.

    Raises
    ------
    DsnetError
        If the file is damaged, or holds no markers with names, of a person's size.
    """
    with damage_refused(partial(_unreadable, path)):
        data, labels = _read_npz(path)
    if data.ndim != 3 or data.shape[1:] != (len(labels), 3) or not len(labels):
        raise _refused(
            path,
            f"markers of shape {data.shape} with {len(labels)} names",
            "(T, N, 3) with N names",
        )
    if len({name for name in labels if name.strip("*0123456789 ")}) < 4:
        raise _refused(
            path,
            f"markers without names ({', '.join(labels[:3])}, ...)",
            "names such as C7, CLAV, LBUST",
            "Label them, as MoSh++ and AMASS do",
        )
    data[~data.any(axis=2)] = np.nan  # some files write a marker that was not seen as zeros
    if not (np.isfinite(data).all(axis=2).mean(axis=0) > SEEN_ENOUGH).any():
        raise _refused(path, "markers that are hardly ever seen", "most of them in most frames")
    data, note = _in_metres(path, data)
    upright = Y_UP_FROM_Z_UP.apply(data.reshape(-1, 3)).reshape(data.shape)
    names = [label.rpartition(":")[2].strip().upper() for label in labels]
    return Markers(upright, tuple(_SAME_PLACE.get(n, n) for n in names), fps, note)


def _in_metres(path: Path, data: NDArray) -> tuple[NDArray[np.float64], str]:
    """Metres, by the room that the markers of one moment take up."""
    seen = np.asarray(np.isfinite(data).all(axis=2))
    some = data[seen.any(axis=1)]
    extent = float(np.median(np.nanmax(some, axis=1) - np.nanmin(some, axis=1), axis=0).max())
    for unit, per_m in (("metres", 1.0), ("millimetres", 1e3), ("centimetres", 1e2)):
        if _PERSON_M[0] <= extent / per_m <= _PERSON_M[1]:
            return data / per_m, "" if per_m == 1 else f"its markers are in {unit}: converted"
    raise _refused(path, f"markers {extent:.3g} apart", "those of a person, in metres")


def _read_npz(path: Path) -> tuple[NDArray, list[str]]:
    with open_npz(path) as archive:
        for key, most_bytes in (("marker_data", _MOST_BYTES), ("marker_labels", 1 << 20)):
            if key not in archive:
                raise _refused(
                    path,
                    f"a file without {key!r}",
                    "marker_data (T, N, 3) and marker_labels (N,)",
                    "AMASS's SMPL-H release has them; the SMPL-X release does not",
                )
            archive.check(key, most_bytes)
        labels = archive.array("marker_labels").ravel()
        data = archive.array("marker_data")
    if data.dtype.kind not in "iuf" or labels.dtype.kind not in "US":
        raise _refused(path, f"markers of types {data.dtype} and {labels.dtype}", "numbers, names")
    return data.astype(np.float64), [_text(label) for label in labels]


def _text(value: object) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _resampled(points: NDArray, fps: float, to_fps: float, count: int) -> NDArray[np.float64]:
    if len(points) == count and abs(fps - to_fps) < 0.01:
        return points
    if fps > 1.5 * to_fps:  # what is faster than the new rate can hold would fold back
        low = butter(4, 0.45 * to_fps, fs=fps, output="sos")
        points = np.asarray(sosfiltfilt(low, points, axis=0), np.float64)
    at_s = np.minimum(np.arange(count) / to_fps, (len(points) - 1) / fps)
    return np.asarray(CubicSpline(np.arange(len(points)) / fps, points)(at_s), np.float64)


def _unreadable(path: Path, error: Exception) -> DsnetError:
    return _refused(path, f"a file that does not load ({str(error)[:200]})", "markers")


def _refused(
    path: Path, received: str, expected: str, remedy: str = "Pass a file with skin markers"
) -> DsnetError:
    return DsnetError(f"{path}, {received}", expected, f"{remedy}.")
