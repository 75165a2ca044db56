"""A terminal is told how far long work is; a pipe or a file is told nothing."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

DSNET = (sys.executable, "-c", "from dsnet.cli import main; main()")
OF_MOTION = ("--motion", "sample:jumping_jacks")


def on_terminal(*arguments: str | Path) -> str:
    """What a command prints on a pseudo-terminal as its stderr."""
    shown, given = pty.openpty()
    fcntl.ioctl(given, termios.TIOCSWINSZ, struct.pack("4H", 24, 100, 0, 0))
    with subprocess.Popen([*DSNET, *map(str, arguments)], stderr=given) as process:
        os.close(given)
        said = bytearray()
        while process.poll() is None or not said:
            try:
                said += os.read(shown, 1 << 16)
            except OSError:  # all of it was read, and nobody writes any more
                break
    os.close(shown)
    assert process.returncode == 0, said.decode()
    return said.decode()


@pytest.mark.parametrize(
    ("command", "what"),
    [
        (("predict", "--write", "offsets,vertices"), "predict"),
        (("export", "--to", "pc2"), "points"),
    ],
    ids=["predict", "pc2"],
)
def test_a_terminal_sees_frames_rate_and_time_left(command, what, tmp_path):
    said = on_terminal(*command, *OF_MOTION, "--out", tmp_path / "out")
    assert f"{what}: 100%" in said
    assert "240/240" in said
    assert "frame/s" in said


def test_a_pipe_sees_no_bar(tmp_path):
    command = [*DSNET, "predict", "--write", "offsets,vertices", *OF_MOTION]
    command += ["--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert len(done.stderr.splitlines()) == 2  # who predicts, and what was written
    assert not (tmp_path / "out" / "strip.png").exists()
    assert done.stdout == ""
