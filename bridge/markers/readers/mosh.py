"""What MoSh++ writes, `*_stageii.pkl`: markers beside the pose that was fitted to them."""

from __future__ import annotations

from pathlib import Path

from bridge.body.safe_pickle import as_array
from bridge.markers.stored import Stored, refused
from bridge.motion.readers.mosh import load_fields, sniff, within

__all__ = ["has_markers", "read", "sniff"]


def has_markers(path: Path) -> bool:
    """Those that a pose was fitted to are all there."""
    return True


def read(path: Path) -> Stored:
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
    texts = [name.decode(errors="replace") if isinstance(name, bytes) else name for name in names]
    if not all(isinstance(text, str) for text in texts):
        raise refused(path, "names of markers that are no text", "text")
    pose = as_array(fields["fullpose"])
    vertices = fields.get("markers_latent_vids", within(fields.get("marker_meta"), "marker_vids"))
    is_smpl = pose.shape[-1:] != (165,)
    return Stored(
        as_array(points),
        texts,
        vertices=vertices if is_smpl and isinstance(vertices, dict) else {},
    )
