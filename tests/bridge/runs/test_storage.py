"""Arrays that are written in pieces: room is taken first, and damage is told from work done."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bridge.runs.digests import arrays_sha256
from bridge.runs.storage import is_written, map_array, mark_written, save_array

LIMITED = """
import resource, sys
from pathlib import Path
from bridge.endings import exit_with_one_line
from bridge.runs.digests import arrays_sha256
from bridge.runs.storage import map_array
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
with exit_with_one_line():
    map_array(Path(sys.argv[1]), (1000, 1000), "f4")[:] = 1
"""


def test_without_room_there_is_one_line_and_no_array(tmp_path):
    """Where a mapped file ends the process would be killed by SIGBUS."""
    path = tmp_path / "x.npy"
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(path)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "File too large; expected room on the disk" in done.stderr
    assert not path.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="counts blocks of the file system")
def test_room_is_taken_before_anything_is_written(tmp_path):
    path = tmp_path / "x.npy"
    map_array(path, (1000, 1000), np.float32)
    assert path.stat().st_blocks * 512 >= 4_000_000


@pytest.mark.parametrize("damage", ["empty", "half a header", "another shape"])
def test_what_cannot_be_gone_on_with_is_begun_again(damage, tmp_path):
    path = tmp_path / "x.npy"
    map_array(path, (3, 2) if damage == "another shape" else (4, 2), np.float64)[:] = 7
    if damage != "another shape":
        path.write_bytes(path.read_bytes()[: 0 if damage == "empty" else 50])
    array = map_array(path, (4, 2), np.float64)
    assert (array.shape, array.max()) == ((4, 2), 0)


def test_a_mark_holds_for_its_rows_only(tmp_path):
    array, mark = map_array(tmp_path / "x.npy", (4, 2), np.float32), tmp_path / "mark"

    def digest(stop: int) -> str:
        return arrays_sha256({"rows": array[:stop]})

    array[:2] = 1
    assert not is_written(mark, lambda: digest(2))
    mark_written(mark, digest(2))
    array[2:] = 2
    assert is_written(mark, lambda: digest(2))
    assert not is_written(mark, lambda: digest(3))
    array[1, 1] = 3
    assert not is_written(mark, lambda: digest(2))


def test_a_full_disk_says_so(tmp_path):
    """`numpy.save` into a file loses the system's reason."""
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    with pytest.raises(OSError, match="No space left") as full:
        save_array(Path("/dev/full"), np.zeros(100_000))
    assert full.value.errno == errno.ENOSPC
