"""Files of recorded markers, by suffix, and which pose lies beside which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bridge.motion.markers import MarkerFile, StoredMarkers
from bridge.motion.readers.c3d import read_c3d
from bridge.motion.readers.marker_text import read_text

_POSE_ENDINGS = (".npz", "_poses.npz", "_stageii.npz", "_stageii.pkl")
"""Of a pose's file that lies beside the recording that it was fitted to."""
_READERS: dict[str, Callable[[Path], StoredMarkers]] = {
    ".c3d": read_c3d,
    ".trc": read_text,
    ".tsv": read_text,
    ".csv": read_text,
}
_OF_MARKERS_ALONE = (".c3d", ".trc")
"""What has one of these beside a pose is markers; other tables may be anything."""


def is_recording(path: Path) -> bool:
    """By its name."""
    return path.suffix.lower() in _READERS


def recording(path: Path) -> MarkerFile:
    """The markers in one of these files."""
    return MarkerFile(path, _READERS[path.suffix.lower()])


def recording_beside(path: Path) -> Path | None:
    """The recording that lies beside a file of poses under its name, if one does."""
    stems = [path.name.removesuffix(end) for end in _POSE_ENDINGS if path.name.endswith(end)]
    beside = (path.with_name(f"{stem}{end}") for end in _OF_MARKERS_ALONE for stem in stems)
    return next((one for one in beside if one.is_file()), None)


def poses_beside(path: Path) -> list[Path]:
    """Where the pose of a recording may lie."""
    return [path.with_name(path.stem + ending) for ending in _POSE_ENDINGS]
