"""Clips of moving bodies: an animated GIF, and an H.264 MP4."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from bridge.errors import DsnetError
from dsnet.exporters.clip_pictures import RenderedClip
from dsnet.exporters.output import facts_in_a_line
from dsnet.prediction.moving_body import MovingBody

LONGEST_GIF_S = 60.0
"""Longest GIF: it is held in memory as a whole, and a longer one would be too large to use."""
_GIF_FPS, _GIF_BODY_PX = 20.0, 210
_MP4_FPS, _MP4_BODY_PX = 30.0, 290
# Every fourth grey, as Pillow rounds colours down to multiples of four before it looks them up.
_GREYS = (255, *range(248, 160, -4))


def write_gif(
    path: Path, *moving: MovingBody, body_px: int = _GIF_BODY_PX, recorded: str = ""
) -> None:
    """Write 20 pictures a second; one body for each predictor, in the same motion.

    Parameters
    ----------
    body_px : width for each body, an even number.
    recorded : source of the motion, if it was recorded; it is written below the pictures.
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
        comment=facts_in_a_line(*moving).encode("ascii"),
    )


def _palette(page: Image.Image) -> Image.Image:
    """256 colours: greys for soft shadows without bands, and the rest from a page."""
    others = 256 - len(_GREYS)
    reduced = page.quantize(others, method=Image.Quantize.MAXCOVERAGE, kmeans=3)
    palette = Image.new("P", (1, 1))
    greys = np.repeat(_GREYS, 3).tolist()
    palette.putpalette(greys + (reduced.getpalette() or [])[: 3 * others])
    return palette


def write_mp4(path: Path, *moving: MovingBody, body_px: int = _MP4_BODY_PX) -> None:
    """Write 30 pictures a second, as `write_gif`; raises `OSError` if the encoder fails."""
    clip = RenderedClip(moving, fps=_MP4_FPS, body_px=body_px)
    encode_mp4(path, clip, size_px=clip.size_px, fps=clip.fps, comment=facts_in_a_line(*moving))


def encode_mp4(
    path: Path, pages: Iterable[Image.Image], *, size_px: tuple[int, int], fps: float, comment: str
) -> None:
    """Write pages of even width and height as H.264, which browsers play.

    Raises `OSError` if the encoder fails. Needs the extra `clip`.
    """
    import imageio_ffmpeg

    size = "x".join(map(str, size_px))
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{fps:g}", "-i", "-"]
    codec = ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p"]
    # The index comes first, so that a browser plays the file while it loads.
    container = ["-movflags", "+faststart", "-metadata", f"comment={comment}"]
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    command = [ffmpeg, "-v", "error", *source, *codec, *container, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        try:
            for page in pages:
                encoder.stdin.write(page.tobytes())
        except BrokenPipeError:
            pass  # the encoder's own message is raised below
        except BaseException:
            encoder.kill()
            raise
        message = encoder.communicate()[1].decode(errors="replace").strip()
    if encoder.returncode:
        failure = f"ffmpeg ended with {encoder.returncode}"
        raise OSError(message.splitlines()[-1] if message else failure)
