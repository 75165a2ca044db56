"""Markers in files of poses: AMASS's and MoSh++'s.

An AMASS `.npz` of the SMPL-H release calls them `marker_data` and `marker_labels`, one that MoSh++
exports `markers` and `labels`; `*_stageii.pkl` is MoSh++'s own.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bridge.body.pickled_arrays import as_array
from bridge.body.safe_pickle import load_restricted_item
from bridge.motion.markers import MarkerFile, StoredMarkers, refused
from bridge.motion.motion import MOST_FRAMES
from bridge.motion.readers.c3d import c3d_beside, read_c3d
from bridge.runs.untrusted import UntrustedNpz, open_npz

_MOST_MARKERS = 500
_KEYS = (("marker_data", "marker_labels"), ("markers", "labels"))
_VERTICES = "markers_latent_vids"
_SMPLX_POSE = (165,)


def markers_beside_poses(archive: UntrustedNpz, path: Path) -> MarkerFile | None:
    """Those of an `.npz`, else those of a C3D beside it."""
    if keys := marker_keys(archive):
        return MarkerFile(path, partial(_read_npz, keys))
    beside = c3d_beside(path)
    return None if beside is None else MarkerFile(beside, read_c3d)


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
    return _stored(path, points, labels.ravel().tolist(), vertices)


def marker_keys(archive: UntrustedNpz) -> tuple[str, str] | None:
    """The names of marker places and labels, None where it has no markers."""
    return next((keys for keys in _KEYS if all(key in archive for key in keys)), None)


def _is_smpl(archive: UntrustedNpz) -> bool:
    """Whether its pose is of a body with SMPL's vertices; SMPL-X has others."""
    return "poses" in archive and archive["poses"].shape[-1:] != _SMPLX_POSE


def from_mosh(fields: Mapping[str, Any], path: Path) -> StoredMarkers:
    """The markers of `stageii_debug_details`, and the vertices that MoSh++ gave them."""
    details = fields.get("stageii_debug_details")
    points, labels = (within(details, key) for key in ("markers_orig", "labels_orig"))
    if points is None or labels is None:
        raise refused(
            path,
            "a result of MoSh++ without 'markers_orig' and 'labels_orig'",
            "the markers that it was fitted to, in stageii_debug_details",
            "Run MoSh++ again, or put the .c3d beside its .npz",
        )
    names = labels if isinstance(labels, list) else as_array(labels).ravel().tolist()
    vertices = fields.get(_VERTICES, within(fields.get("marker_meta"), "marker_vids"))
    is_smpl = as_array(fields["fullpose"]).shape[-1:] != _SMPLX_POSE
    return _stored(path, as_array(points), names, vertices if is_smpl else None)


def _stored(path: Path, points: NDArray, labels: list, vertices: object) -> StoredMarkers:
    names = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in labels]
    if not all(isinstance(name, str) for name in names):
        raise refused(path, "names of markers that are no text", "text")
    return StoredMarkers(points, names, vertices=vertices if isinstance(vertices, dict) else {})


def within(value: Any, *names: str) -> Any:
    """What lies under names in dictionaries in one another; None where there is nothing."""
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    return value
