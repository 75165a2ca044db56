"""An animated GIF of moving bodies: 20 pictures a second, all in the same colours."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from bridge.errors import DsnetError
from bridge.export.about import about_in_a_line
from bridge.export.clip import RenderedClip
from bridge.runtime.moving_body import MovingBody

LONGEST_S = 60.0
"""A GIF is held in memory as a whole; a longer one would also be too large for any use."""
_FPS, _BODY_PX = 20.0, 210


def write(path: Path, *moving: MovingBody, body_px: int = _BODY_PX, recorded: str = "") -> None:
    """Write the file; of several predictors each moves a body of its own, in the same motion.

    Parameters
    ----------
    body_px : room for each body, from left to right; an even number.
    recorded : whose motion it is, if it was recorded; stands below the pictures.

    Raises
    ------
    DsnetError
        If the motion lasts longer than a GIF may.
    """
    duration_s = moving[0].motion.duration_s
    if duration_s > LONGEST_S:
        raise DsnetError(
            f"--to gif of {duration_s:.0f} s",
            f"at most {LONGEST_S:.0f} s",
            "Pass --to mp4, or a shorter motion.",
        )
    clip = RenderedClip(moving, fps=_FPS, body_px=body_px, recorded=recorded)
    palette = clip.with_all_colours().quantize(method=Image.Quantize.MAXCOVERAGE, kmeans=3)
    pages = (page.quantize(palette=palette, dither=Image.Dither.NONE) for page in clip)
    next(pages).save(
        path,
        save_all=True,
        append_images=pages,
        duration=round(1000 / clip.fps),
        loop=0,
        comment=about_in_a_line(*moving).encode("ascii"),
    )
