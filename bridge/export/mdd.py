"""A point cache of LightWave's kind (MDD), which Blender, Maya, Houdini and others read.

Big-endian: the numbers of frames and points, the time of every frame in seconds as float32; then
x, y, z of every point, frame by frame.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from bridge.export.point_cache import positions, write_companions
from bridge.runtime.moving_body import MovingBody


def write(folder: Path, moving: MovingBody) -> None:
    """Write `body.mdd`, its base mesh and `about.json` into an empty folder."""
    times_s = np.arange(len(moving)) / moving.motion.fps
    with (folder / "body.mdd").open("wb") as file:
        file.write(struct.pack(">ii", len(moving), moving.body.vertex_count))
        file.write(times_s.astype(">f4").tobytes())
        file.writelines(positions(moving, ">f4"))
    write_companions(folder, moving)
