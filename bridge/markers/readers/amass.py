"""An `.npz` with markers beside the pose that was fitted to them: AMASS's SMPL-H release calls them
`marker_data` and `marker_labels`, what MoSh++ exports `markers` and `labels`."""

from __future__ import annotations

from pathlib import Path

from bridge.body.safe_pickle import load_restricted_item
from bridge.markers.stored import Stored, refused
from bridge.motion.motion import MOST_FRAMES
from bridge.runs.untrusted import NpyHeader, UntrustedNpz, open_npz

MOST_MARKERS = 500
_KEYS = (("marker_data", "marker_labels"), ("markers", "labels"))
_VERTICES = "markers_latent_vids"


def sniff(path: Path) -> bool:
    """By its name."""
    return path.suffix == ".npz"


def has_markers(path: Path) -> bool:
    """By the names of its arrays."""
    with open_npz(path) as archive:
        return _keys(archive) is not None


def read(path: Path) -> Stored:
    """Both arrays, and the vertex of each marker where the file has it."""
    with open_npz(path) as archive:
        if (keys := _keys(archive)) is None:
            raise refused(
                path,
                "a file without 'marker_data' and 'marker_labels'",
                "markers (T, N, 3) and their names (N,), or a .c3d of the same name beside it",
                "AMASS's SMPL-H release has them; the SMPL-X release does not",
            )
        archive.check(keys[0], MOST_FRAMES * MOST_MARKERS * 3 * 8)
        archive.check(keys[1], 1 << 20)
        points, labels = (archive.array(key) for key in keys)
        vertices = {}
        if _VERTICES in archive and archive[_VERTICES].dtype.hasobject and _is_smpl(archive):
            with archive.member(_VERTICES) as stream:
                NpyHeader.read(stream)
                vertices = load_restricted_item(stream)
    if labels.dtype.kind not in "US":
        raise refused(path, f"names of type {labels.dtype}", "text")
    names = [
        name.decode(errors="replace") if isinstance(name, bytes) else str(name)
        for name in labels.ravel()
    ]
    return Stored(points, names, vertices=vertices if isinstance(vertices, dict) else {})


def _keys(archive: UntrustedNpz) -> tuple[str, str] | None:
    return next((keys for keys in _KEYS if all(key in archive for key in keys)), None)


def _is_smpl(archive: UntrustedNpz) -> bool:
    """Whether its pose is of a body with SMPL's vertices; SMPL-X has others."""
    return "poses" in archive and archive["poses"].shape[-1:] != (165,)
