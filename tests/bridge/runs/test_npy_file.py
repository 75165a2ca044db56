"""Headers of `.npy`: whoever wrote them, and however many threads read them at once."""

from __future__ import annotations

import gc
import io
import struct
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from bridge.runs.npy_file import NpyHeader, read_npy
from bridge.runs.storage import map_npy, save_array

THREADS, READS = 16, 100_000


def written(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def with_header(text: str, version: int = 1) -> io.BytesIO:
    length = struct.pack("<H" if version == 1 else "<I", len(text))
    return io.BytesIO(b"\x93NUMPY" + bytes([version, 0]) + length + text.encode() + bytes(240))


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((0, 3)),
        np.array(3.5),
        np.array("hé"),
        np.array([b"ab", b"c"]),
        np.array([True, False]),
        np.arange(5).astype(">i2"),
        np.full((2, 1), 1 + 2j, np.complex64),
        np.asfortranarray(np.arange(12.0).reshape(3, 4)),
    ],
)
def test_what_numpy_writes_is_read(array, tmp_path):
    read = read_npy(io.BytesIO(written(array)))
    path = tmp_path / "x.npy"
    path.write_bytes(written(array))
    for one in (read, map_npy(path)):
        np.testing.assert_array_equal(one, array)
        assert (one.dtype, one.shape) == (array.dtype, array.shape)
    assert read.flags.writeable


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (10L, 3L), }   \n", 1),  # Python 2
        ("{'shape': (10, 3), 'fortran_order': False, 'descr': '<f8'}", 1),
        ('{"descr":"<f8","fortran_order":False,"shape":(10,3)}\n', 2),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (10, 3), }", 3),
    ],
)
def test_so_is_what_others_and_older_ones_write(text, version):
    array = read_npy(with_header(text, version))
    assert (array.shape, array.dtype) == ((10, 3), np.dtype("f8"))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "{'descr': '<f8', 'shape': (3,), 'shape': (3,)}",
        "{'descr': '<f8' 'fortran_order': False, 'shape': (3,)}",
        "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (3,)}",
        "{'descr': '<f3', 'fortran_order': False, 'shape': (3,)}",
        "{'descr': '<U9999999999', 'fortran_order': False, 'shape': (3,)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-3,)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (31,)}",  # more than there is
        "{'descr': '|O', 'fortran_order': False, 'shape': (3,)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1, " * 70 + ")}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (__import__('os').getpid(),)}",
        "{" + " " * 9000 + "'descr': '<f8'",
    ],
)
def test_anything_else_is_refused(text, tmp_path):
    stream = with_header(text)
    with pytest.raises(ValueError, match=r"none of a \.npy|Python objects|last 8 bytes|dimension"):
        read_npy(stream)
    path = tmp_path / "x.npy"
    path.write_bytes(stream.getvalue())
    with pytest.raises(ValueError, match=r"none of a \.npy|in it|dimension"):
        map_npy(path, "r+")
    assert path.read_bytes() == stream.getvalue()


def runs_python(*_: object) -> None:
    list(map(id, range(3)))


@pytest.fixture
def busy_interpreter() -> Iterator[None]:
    """Threads change places at every chance, and the collector runs Python in the midst of all."""
    interval, threshold = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(1e-6)
    gc.set_threshold(3)
    gc.callbacks.append(runs_python)
    yield
    gc.callbacks.remove(runs_python)
    gc.set_threshold(*threshold)
    sys.setswitchinterval(interval)


@pytest.mark.usefixtures("busy_interpreter")
def test_threads_that_read_at_once_all_read_it():
    data, failed = written(np.zeros((2, 10), np.float32)), []

    def read() -> None:
        for _ in range(READS // THREADS):
            try:
                NpyHeader.read(io.BytesIO(data))
            except BaseException as error:
                failed.append(error)

    threads = [threading.Thread(target=read) for _ in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []


def test_an_array_that_was_cut_is_not_mapped(tmp_path):
    path = tmp_path / "x.npy"
    save_array(path, np.zeros(3))
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ValueError, match="in it"):
        map_npy(path)
