"""Arrays that are written in pieces, and digests of files that may have changed."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from bridge.errors import DsnetError, InterruptedWorkError
from bridge.runs import files
from bridge.runs.files import (
    ArrayFile,
    arrays_sha256,
    exclusive,
    is_written,
    mark_written,
    sha256_of,
    stamp_of,
)

LIMITED = """
import resource, sys
from pathlib import Path
from bridge.processes import exit_with_one_line
from bridge.runs.files import ArrayFile
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
with exit_with_one_line():
    ArrayFile.at(Path(sys.argv[1]), (1000, 1000), "f4")
"""


def test_without_room_there_is_one_line_and_no_array(tmp_path):
    path = tmp_path / "x.npy"
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(path)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "File too large; expected room on the disk" in done.stderr
    assert not path.exists()


@pytest.mark.parametrize("damage", ["empty", "half a header", "another shape"])
def test_what_cannot_be_gone_on_with_is_begun_again(damage, tmp_path):
    path = tmp_path / "x.npy"
    shape = (3, 2) if damage == "another shape" else (4, 2)
    ArrayFile.at(path, shape, np.float64).write(0, np.full(shape, 7))
    if damage != "another shape":
        path.write_bytes(path.read_bytes()[: 0 if damage == "empty" else 50])
    array = ArrayFile.at(path, (4, 2), np.float64).read(slice(None))
    assert (array.shape, array.max()) == ((4, 2), 0)


def test_an_array_is_gone_on_with(tmp_path):
    path = tmp_path / "x.npy"
    ArrayFile.at(path, (4, 2), np.float32).write(1, [[1, 2], [3, 4]])
    again = ArrayFile.at(path, (4, 2), np.float32)
    again.write(3, [[5, 6]])
    np.testing.assert_array_equal(np.load(path), [[0, 0], [1, 2], [3, 4], [5, 6]])
    np.testing.assert_array_equal(again.read(slice(1, 3)), [[1, 2], [3, 4]])
    for start, rows in ((3, np.zeros((2, 2))), (-1, np.zeros((1, 2))), (0, np.zeros((1, 3)))):
        with pytest.raises(ValueError, match="of shape"):
            again.write(start, rows)


def test_a_mark_holds_for_its_rows_only(tmp_path):
    array, mark = ArrayFile.at(tmp_path / "x.npy", (4, 2), np.float32), tmp_path / "mark"

    def digest(stop: int) -> str:
        return arrays_sha256({"rows": array.read(slice(stop))})

    array.write(0, np.ones((2, 2)))
    assert not is_written(mark, lambda: digest(2))
    mark_written(mark, digest(2))
    array.write(2, np.full((2, 2), 2))
    assert is_written(mark, lambda: digest(2))
    assert not is_written(mark, lambda: digest(3))
    array.write(1, [[1, 3]])
    assert not is_written(mark, lambda: digest(2))


def be_ended(error, path, resumed):
    with exclusive(path, "it", "Wait.", resumed=resumed) as work:
        (work / "half").touch()
        raise error


def test_only_one_is_alone_and_work_stays_only_to_be_resumed(tmp_path):
    path = tmp_path / "a"
    with exclusive(path, "it", "Wait.") as work:
        (work / "half").touch()
        with pytest.raises(DsnetError, match="it, which another process is making"):
            exclusive(path, "it", "Wait.").__enter__()
    assert not list(tmp_path.iterdir())
    for error, resumed, left in (
        (KeyboardInterrupt(), False, []),
        (DsnetError("a", "b", "c"), True, []),
        (InterruptedWorkError("a", "b", "c"), True, ["half", "lock"]),
        (KeyboardInterrupt(), True, ["half", "lock"]),
    ):
        with pytest.raises(type(error)):
            be_ended(error, path, resumed)
        assert sorted(one.name for one in tmp_path.glob("*/*")) == left
    with exclusive(path, "it", "Wait.") as work:
        assert not (work / "half").exists()


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
