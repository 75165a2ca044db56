"""Arrays that are written in pieces, and digests of files that may have changed."""

from __future__ import annotations

import errno
import hashlib
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bridge.runs import files
from bridge.runs.files import (
    arrays_sha256,
    is_written,
    map_array,
    mark_written,
    save_array,
    sha256_of,
    stamp_of,
)

LIMITED = """
import resource, sys
from pathlib import Path
from bridge.processes import exit_with_one_line
from bridge.runs.files import arrays_sha256
from bridge.runs.files import map_array
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


@pytest.fixture
def readings(monkeypatch):
    seen = []

    def count(path):
        seen.append(path)
        return sha256(path)

    monkeypatch.setattr(files, "file_sha256", count)
    return seen


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_file_is_read_once_and_again_when_it_has_changed_even_with_its_old_time(
    tmp_path, readings
):
    path = tmp_path / "x"
    path.write_bytes(b"a" * 100_000)
    time.sleep(0.1)
    for _ in range(3):
        assert sha256_of(path) == sha256(path)
    assert len(readings) == 1
    before = path.stat()
    path.write_bytes(b"a" * 99_999 + b"b")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert sha256_of(path) == sha256(path)
    assert len(readings) == 2


def test_a_file_that_was_changed_just_now_is_not_trusted(tmp_path):
    path = tmp_path / "x"
    for content in (b"c" * 100_000, b"d" * 100_000):
        path.write_bytes(content)
        assert stamp_of(path) is None
        assert sha256_of(path) == hashlib.sha256(content).hexdigest()
