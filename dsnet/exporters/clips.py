"""Clips of moving bodies: an animated GIF, and an H.264 MP4."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from PIL import Image

from bridge.errors import DsnetError
from dsnet.exporters.clip_pictures import RenderedClip
from dsnet.exporters.output import about_in_a_line
from dsnet.prediction.moving_body import MovingBody

LONGEST_GIF_S = 60.0
"""A GIF is held in memory as a whole; a longer one would also be too large for any use."""
_GIF_FPS, _GIF_BODY_PX = 20.0, 210
_MP4_FPS, _MP4_BODY_PX = 30.0, 290
# Pillow looks for the nearest of a colour that it rounds down to fours: of 252 in place of white.
_GREYS = (255, *range(248, 160, -4))


def write_gif(
    path: Path, *moving: MovingBody, body_px: int = _GIF_BODY_PX, recorded: str = ""
) -> None:
    """Write 20 pictures a second; each predictor moves a body of its own, in the same motion.

    Parameters
    ----------
    body_px : room for each body, from left to right; an even number.
    recorded : whose motion it is, if it was recorded; stands below the pictures.
    """
    duration_s = moving[0].motion.duration_s
    if duration_s > LONGEST_GIF_S:
        raise DsnetError(
            f"--to gif of {duration_s:.0f} s",
            f"at most {LONGEST_GIF_S:.0f} s",
            "Pass --to mp4, or a shorter motion.",
        )
    clip = RenderedClip(moving, fps=_GIF_FPS, body_px=body_px, recorded=recorded)
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


def write_mp4(path: Path, *moving: MovingBody, body_px: int = _MP4_BODY_PX) -> None:
    """Write 30 pictures a second, as `write_gif`; if the encoder fails, `OSError` says why."""
    import imageio_ffmpeg

    clip = RenderedClip(moving, fps=_MP4_FPS, body_px=body_px)
    size = "x".join(map(str, clip.size_px))
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{clip.fps:g}", "-i", "-"]
    coded = ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p"]
    # The index stands first, so that a browser plays it while it loads.
    told = ["-movflags", "+faststart", "-metadata", f"comment={about_in_a_line(*moving)}"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *given, *coded, *told, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        try:
            for page in clip:
                encoder.stdin.write(page.tobytes())
        except BrokenPipeError:
            pass  # it says why itself
        except BaseException:
            encoder.kill()
            raise
        said = encoder.communicate()[1].decode(errors="replace").strip()
    if encoder.returncode:
        raise OSError(said.splitlines()[-1] if said else f"ffmpeg ended with {encoder.returncode}")
