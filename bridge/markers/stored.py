"""Markers as a file has them beside the pose that was fitted to them, and the refusal of one.

An AMASS `.npz` of the SMPL-H release calls them `marker_data` and `marker_labels`, one that MoSh++
exports `markers` and `labels`; `*_stageii.pkl` is MoSh++'s own. C3D, which has no pose: `c3d`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from numpy.typing import NDArray

from bridge.body.safe_pickle import as_array, load_restricted_item
from bridge.errors import DsnetError
from bridge.motion.motion import MOST_FRAMES
from bridge.motion.readers.mosh import load_fields, within
from bridge.runs.untrusted import NpyHeader, UntrustedNpz, open_npz

_MOST_MARKERS = 500
_KEYS = (("marker_data", "marker_labels"), ("markers", "labels"))
_VERTICES = "markers_latent_vids"
_SMPLX_POSE = (165,)


@dataclass(frozen=True, eq=False)
class Stored:
    """Markers as their file has them."""

    points: NDArray
    """(T, N, 3) numbers, zero or NaN where a marker was not seen."""
    labels: list[str]
    fps: float | None = None
    """None: a row for each frame of the pose."""
    per_m: float | None = None
    """Units in a metre; None where the file does not say."""
    upright: bool = True
    """Whether they are z up, as the pose that was fitted to them; else nobody knows."""
    vertices: Mapping[str, int] = field(default_factory=dict)
    """Of SMPL, by label, where the file says them."""


def refused(
    path: Path, received: str, expected: str, remedy: str = "Pass a file with skin markers"
) -> DsnetError:
    """The refusal of a file."""
    return DsnetError(f"{path}, {received}", expected, f"{remedy}.")


def npz_has_markers(path: Path) -> bool:
    """By the names of its arrays."""
    with open_npz(path) as archive:
        return _keys(archive) is not None


def read_npz(path: Path) -> Stored:
    """Both arrays, and the vertex of each marker where the file has it."""
    with open_npz(path) as archive:
        if (keys := _keys(archive)) is None:
            raise refused(
                path,
                "a file without 'marker_data' and 'marker_labels'",
                "markers (T, N, 3) and their names (N,), or a .c3d of the same name beside it",
                "AMASS's SMPL-H release has them; the SMPL-X release does not",
            )
        archive.check(keys[0], MOST_FRAMES * _MOST_MARKERS * 3 * 8)
        archive.check(keys[1], 1 << 20)
        points, labels = (archive.array(key) for key in keys)
        vertices = None
        if _VERTICES in archive and archive[_VERTICES].dtype.hasobject and _is_smpl(archive):
            with archive.member(_VERTICES) as stream:
                NpyHeader.read(stream)
                vertices = load_restricted_item(stream)
    if labels.dtype.kind not in "US":
        raise refused(path, f"names of type {labels.dtype}", "text")
    return _stored(path, points, labels.ravel().tolist(), vertices)


def _keys(archive: UntrustedNpz) -> tuple[str, str] | None:
    return next((keys for keys in _KEYS if all(key in archive for key in keys)), None)


def _is_smpl(archive: UntrustedNpz) -> bool:
    """Whether its pose is of a body with SMPL's vertices; SMPL-X has others."""
    return "poses" in archive and archive["poses"].shape[-1:] != _SMPLX_POSE


def read_mosh(path: Path) -> Stored:
    """The markers of `stageii_debug_details`, and the vertices that MoSh++ found for them."""
    fields = load_fields(path)
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


def _stored(path: Path, points: NDArray, labels: list, vertices: object) -> Stored:
    names = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in labels]
    if not all(isinstance(name, str) for name in names):
        raise refused(path, "names of markers that are no text", "text")
    return Stored(points, names, vertices=vertices if isinstance(vertices, dict) else {})
