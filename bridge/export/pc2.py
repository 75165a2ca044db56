"""A point cache of 3ds Max's kind (PC2), which Blender's Mesh Cache and others read.

Little-endian: the signature, version 1, the number of points, the first frame and the frames
between samples as float32, the number of samples; then x, y, z of every point, frame by frame. The
rate is the scene's: a sample a frame, at 60 frames a second.
"""

from __future__ import annotations

import struct
from pathlib import Path

from bridge.export.point_cache import positions, write_companions
from bridge.runtime.moving_body import MovingBody


def write(folder: Path, moving: MovingBody) -> None:
    """Write `body.pc2`, its base mesh and `about.json` into an empty folder."""
    points = moving.body.vertex_count
    header = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, 0.0, 1.0, len(moving))
    with (folder / "body.pc2").open("wb") as file:
        file.write(header)
        file.writelines(positions(moving, "<f4"))
    write_companions(folder, moving)
