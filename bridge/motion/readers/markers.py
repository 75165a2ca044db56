"""Markers in files of poses: AMASS's and MoSh++'s.

An AMASS `.npz` of the SMPL-H release calls them `marker_data` and `marker_labels`, one that MoSh++
exports `markers` and `labels`; `*_stageii.pkl` is MoSh++'s own. Its older layout, as SAMP's files
have it, holds `pose_est_obmrks` and in `pose_est_mrk_labels` the names, which each frame may have
of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.pickled_arrays import Record, array_parts, as_array, holds_objects, plain_text
from bridge.body.safe_pickle import load_restricted_item
from bridge.motion.markers import MarkerFile, StoredMarkers, refused
from bridge.motion.motion import MOST_FRAMES
from bridge.motion.readers.recordings import recording, recording_beside
from bridge.runs.untrusted import UntrustedNpz, open_npz

_MOST_MARKERS = 500
OLDER = "pose_est_obmrks", "pose_est_mrk_labels"
"""Of MoSh++'s older layout."""
_KEYS = (("marker_data", "marker_labels"), ("markers", "labels"), OLDER)
_MOST_BYTES = 1 << 30
_VERTICES = "markers_latent_vids"
_SMPLX_POSE = (165,)


def markers_beside_poses(archive: UntrustedNpz, path: Path) -> MarkerFile | None:
    """Those of an `.npz`, else those of a recording beside it."""
    if keys := marker_keys(archive):
        return MarkerFile(path, partial(_read_npz, keys))
    beside = recording_beside(path)
    return None if beside is None else recording(beside)


def _read_npz(keys: tuple[str, str], path: Path) -> StoredMarkers:
    """Both arrays, and the vertex of each marker where the file has it."""
    with open_npz(path) as archive:
        archive.check(keys[0], MOST_FRAMES * _MOST_MARKERS * 3 * 8)
        archive.check(keys[1], 1 << 20)
        points, labels = (archive.array(key) for key in keys)
        vertices = None
        if _VERTICES in archive and archive[_VERTICES].dtype.hasobject and _is_smpl(archive):
            with archive.member(_VERTICES) as stream:
                vertices = load_restricted_item(stream)
    if labels.dtype.kind not in "US":
        raise refused(path, f"names of type {labels.dtype}", "text")
    if labels.ndim == 2 and len(labels) == len(points):
        return _stored(path, *_by_name(points, labels.tolist()))
    return _stored(path, points, labels.ravel().tolist(), vertices)


def marker_keys(archive: UntrustedNpz) -> tuple[str, str] | None:
    """The names of marker places and labels, None where it has no markers."""
    return next((keys for keys in _KEYS if all(key in archive for key in keys)), None)


def _is_smpl(archive: UntrustedNpz) -> bool:
    """Whether its pose is of a body with SMPL's vertices; SMPL-X has others."""
    return "poses" in archive and archive["poses"].shape[-1:] != _SMPLX_POSE


def from_mosh(fields: Mapping[str, Any], path: Path) -> StoredMarkers:
    """The markers of `stageii_debug_details`, and the vertices that MoSh++ gave them; or those of
    the older layout."""
    if all(key in fields for key in OLDER):
        places, labels = (fields[key] for key in OLDER)
        frames = places if isinstance(places, list) else as_array(places)
        return _stored(path, *_by_name(frames, _texts(labels)))
    details = fields.get("stageii_debug_details")
    points, labels = (within(details, key) for key in ("markers_orig", "labels_orig"))
    if points is None or labels is None:
        raise refused(
            path,
            "a result of MoSh++ without 'markers_orig' and 'labels_orig'",
            "the markers that it was fitted to, in stageii_debug_details",
            "Run MoSh++ again, or put the .c3d beside its .npz",
        )
    names = _texts(labels)
    vertices = fields.get(_VERTICES, within(fields.get("marker_meta"), "marker_vids"))
    is_smpl = as_array(fields["fullpose"]).shape[-1:] != _SMPLX_POSE
    return _stored(path, as_array(points), names, vertices if is_smpl else None)


def _texts(value: Any, depth: int = 2) -> list[Any]:
    """Names in a list or an array, of text or of objects, or of each frame in one of its own."""
    if isinstance(value, Record) and value.kind in ("array", "buffer"):
        shape, dtype, _, items = array_parts(value)
        if not holds_objects(dtype):
            items = as_array(value).tolist()
        elif len(shape) == 2:
            items = [items[start : start + shape[1]] for start in range(0, len(items), shape[1])]
        value = items
    if not isinstance(value, list):
        raise ValueError("no list of names")
    nested = (list, Record)
    return [
        _texts(one, depth - 1)
        if isinstance(text := plain_text(one), nested) and depth > 1
        else text
        for one in value
    ]


def _by_name(frames: Any, names: list[Any]) -> tuple[NDArray[np.float64], list[Any]]:
    """(T, N, 3) and N names of the places in T frames, where each may have names of its own; NaN
    where a frame has none of a name."""
    if not all(isinstance(own, list) for own in names):
        names = [names] * len(frames)
    if len(names) != len(frames):
        raise ValueError(f"names of {len(names)} frames beside places of {len(frames)}")
    columns = {name: number for number, name in enumerate(dict.fromkeys(chain(*names)))}
    if len(columns) > _MOST_MARKERS or len(frames) * len(columns) * 24 > _MOST_BYTES:
        raise ValueError(f"{len(columns)} names of markers in {len(frames)} frames")
    whole = np.full((len(frames), len(columns), 3), np.nan)
    for row, own in enumerate(names):
        places = frames[row] if isinstance(frames, np.ndarray) else as_array(frames[row])
        whole[row, [columns[name] for name in own]] = places
    return whole, [*columns]


def _stored(path: Path, points: NDArray, labels: list, vertices: object = None) -> StoredMarkers:
    names = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in labels]
    if not all(isinstance(name, str) for name in names):
        raise refused(path, "names of markers that are no text", "text")
    return StoredMarkers(points, names, vertices=vertices if isinstance(vertices, dict) else {})


def within(value: Any, *names: str) -> Any:
    """What lies under names in dictionaries in one another; None where there is nothing."""
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    return value
