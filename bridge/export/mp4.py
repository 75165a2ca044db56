"""An H.264 clip of moving bodies: 30 pictures a second."""

from __future__ import annotations

import subprocess
from pathlib import Path

import imageio_ffmpeg

from bridge.export.about import about_in_a_line
from bridge.export.clip import RenderedClip
from bridge.runtime.moving_body import MovingBody

_FPS, _BODY_PX = 30.0, 290


def write(path: Path, *moving: MovingBody, body_px: int = _BODY_PX) -> None:
    """Write the file; of several predictors each moves a body of its own, in the same motion.

    Parameters
    ----------
    body_px : room for each body, from left to right; an even number.

    Raises
    ------
    OSError
        If the encoder fails, with what it said.
    """
    clip = RenderedClip(moving, fps=_FPS, body_px=body_px)
    command = _command(clip, path, about_in_a_line(*moving))
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            for page in clip:
                encoder.stdin.write(page.tobytes())
            encoder.stdin.close()
        except BrokenPipeError:
            pass  # it says why itself
        except BaseException:
            encoder.kill()
            raise
        said = encoder.stderr.read().decode(errors="replace").strip()
    if encoder.returncode:
        raise OSError(said.splitlines()[-1] if said else f"ffmpeg ended with {encoder.returncode}")


def _command(clip: RenderedClip, path: Path, comment: str) -> list[str]:
    """What encodes raw pictures from its standard input."""
    size = "x".join(map(str, clip.size_px))
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{clip.fps:g}", "-i", "-"]
    coded = ["-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p"]
    # The index stands first, so that a browser plays it while it loads.
    told = ["-movflags", "+faststart", "-metadata", f"comment={comment}"]
    binary = imageio_ffmpeg.get_ffmpeg_exe()
    return [binary, "-v", "error", *given, *coded, *told, str(path)]
