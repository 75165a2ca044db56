"""A process killed before any of its operations on files: nothing that was finished is lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TOY = Path(__file__).with_name("toy_stage.py")


@pytest.mark.parametrize("replacing", ["fresh", "replacing"])
def test_a_kill_before_any_file_operation_loses_nothing(replacing, tmp_path):
    """What was made is not made again, bytes are equal, nothing else is left."""
    done = subprocess.run(
        [sys.executable, str(TOY), str(tmp_path), replacing],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.stderr == ""
    assert done.returncode == 0
    assert int(done.stdout) > 40
