"""An H.264 clip of a moving body: 30 pictures a second."""

from __future__ import annotations

from pathlib import Path

import imageio_ffmpeg

from bridge.export.about import about_in_a_line
from bridge.export.clip import Clip
from bridge.runtime.moving_body import MovingBody

_FPS, _WIDTH_PX = 30.0, 640


def write(path: Path, moving: MovingBody) -> None:
    """Write the file."""
    clip = Clip(moving, fps=_FPS, width_px=_WIDTH_PX)
    # The index stands first, so that a browser plays it while it loads.
    options = ["-movflags", "+faststart", "-metadata", f"comment={about_in_a_line(moving)}"]
    writer = imageio_ffmpeg.write_frames(
        str(path), clip.size_px, fps=clip.fps, quality=7, macro_block_size=2, output_params=options
    )
    writer.send(None)
    try:
        for page in clip:
            writer.send(page.tobytes())
    finally:
        writer.close()
