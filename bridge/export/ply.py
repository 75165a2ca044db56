"""One binary PLY a frame: `frame_00000.ply`, ..., with the size of each vertex's skin offset."""

from __future__ import annotations

from pathlib import Path

from trimesh.exchange.ply import export_ply

from bridge.export.about import about_in_a_line
from bridge.export.surface_frames import meshes
from bridge.runs.workers import progress
from bridge.runtime.moving_body import MovingBody


def write(folder: Path, moving: MovingBody) -> None:
    """Write every frame into an empty folder."""
    comment = about_in_a_line(moving)
    frames = progress(meshes(moving), what="ply", unit="frame", total=len(moving))
    for number, mesh in frames:
        data = _with_comment(export_ply(mesh, vertex_normal=True), f"frame {number} of {comment}")
        (folder / f"frame_{number:05d}.ply").write_bytes(data)


def _with_comment(data: bytes, comment: str) -> bytes:
    """The file with one more comment, after the two lines that a header begins with."""
    magic, kind, rest = data.split(b"\n", 2)
    return b"\n".join([magic, kind, f"comment {comment}".encode("ascii"), rest])
