"""An animated GIF of moving bodies: 20 pictures a second, all in the same colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from bridge.errors import DsnetError
from bridge.export.about import about_in_a_line
from bridge.export.clip import RenderedClip
from bridge.runtime.moving_body import MovingBody

LONGEST_S = 60.0
"""A GIF is held in memory as a whole; a longer one would also be too large for any use."""
_FPS, _BODY_PX = 20.0, 210
# Pillow looks for the nearest of a colour that it rounds down to fours: of 252 in place of white.
_GREYS = (255, *range(248, 160, -4))


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
    palette = _palette(clip.with_all_colours())
    pages = (page.quantize(palette=palette, dither=Image.Dither.NONE) for page in clip)
    next(pages).save(
        path,
        save_all=True,
        append_images=pages,
        duration=round(1000 / clip.fps),
        loop=0,
        comment=about_in_a_line(*moving).encode("ascii"),
    )


def _palette(page: Image.Image) -> Image.Image:
    """256 colours of a page and of soft shadows, which few greys would cut into bands."""
    others = 256 - len(_GREYS)
    found = page.quantize(others, method=Image.Quantize.MAXCOVERAGE, kmeans=3)
    palette = Image.new("P", (1, 1))
    greys = np.repeat(_GREYS, 3).tolist()
    palette.putpalette(greys + (found.getpalette() or [])[: 3 * others])
    return palette
