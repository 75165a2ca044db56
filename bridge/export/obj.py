"""One Wavefront OBJ a frame: `frame_00000.obj`, ..."""

from __future__ import annotations

from pathlib import Path

import trimesh
from trimesh.exchange.obj import export_obj

from bridge.export.about import about_in_a_line
from bridge.export.surface_frames import meshes
from bridge.runs.workers import progress
from bridge.runtime.moving_body import MovingBody

_DIGITS = 6
"""After the point: micrometres."""


def write(folder: Path, moving: MovingBody) -> None:
    """Write every frame into an empty folder."""
    comment = about_in_a_line(moving)
    frames = progress(meshes(moving), what="obj", unit="frame", total=len(moving))
    for number, mesh in frames:
        write_obj(folder / f"frame_{number:05d}.obj", mesh, f"frame {number} of {comment}")


def write_obj(path: Path, mesh: trimesh.Trimesh, comment: str) -> None:
    """Write a mesh with its normals, and one line of comment on top."""
    path.write_text(
        export_obj(mesh, include_normals=True, digits=_DIGITS, header=comment), encoding="utf-8"
    )
