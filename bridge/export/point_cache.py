"""What point caches have in common: the base mesh, and a page of facts that they have no room for.

A cache holds positions alone; a tool applies them to a mesh with the same vertices in the same
order, which lies beside it as `body.obj`. It is the body in its first frame.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.export.about import about, about_in_a_line
from bridge.export.obj import write_obj
from bridge.export.surface_frames import meshes
from bridge.runtime.moving_body import MovingBody


def write_companions(folder: Path, moving: MovingBody) -> None:
    """Write `body.obj` and `about.json` into a folder."""
    _, first = next(meshes(moving))
    write_obj(folder / "body.obj", first, f"base mesh of a point cache: {about_in_a_line(moving)}")
    (folder / "about.json").write_text(json.dumps(about(moving), indent=2) + "\n", encoding="utf-8")


def positions(moving: MovingBody, dtype: str) -> Iterator[bytes]:
    """Vertices of frame after frame as x, y, z in metres, in pieces."""
    for posed in moving.shown("points"):
        points: NDArray = np.ascontiguousarray(posed.vertices_m, dtype)
        yield points.tobytes()
