"""Files of strangers: what is damage, what is not, and headers read by many threads at once."""

from __future__ import annotations

import ast
import errno
import gc
import io
import struct
import sys
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError

from bridge.errors import DsnetError
from bridge.exchange.weights import load_checkpoint, save_checkpoint
from bridge.motion.readers import read_motion_file
from bridge.runs import read_artifact, write_artifact
from bridge.runs.files import ArrayFile
from bridge.runs.untrusted import NpyHeader, damage_refused, map_npy, read_npy
from tests.sources import PACKAGES, ROOT, parsed, source_files

# What answers for work, not for a file: a thread that must live, an engine that is compared.
ANSWERS_FOR_WORK = {
    "bridge/plugins.py",
    "bridge/exchange/engine.py",
    "tf_dsnet/framework.py",
}


def refused(error: Exception) -> DsnetError:
    return DsnetError(f"a file ({error})", "another", "Delete it.")


@pytest.mark.parametrize("error", [zlib.error("x"), KeyError("x"), EOFError(), SafetensorError()])
def test_what_a_file_can_cause_is_refused(error):
    with pytest.raises(DsnetError, match="Delete it"), damage_refused(refused, SafetensorError):
        raise error


@pytest.mark.parametrize(
    "error",
    [
        SystemError("AST constructor recursion depth mismatch"),
        MemoryError(),
        RecursionError(),
        ImportError(),
        KeyboardInterrupt(),
        OSError(errno.EMFILE, "Too many open files"),
        DsnetError("received", "expected", "remedy"),
    ],
)
def test_anything_else_passes(error):
    with pytest.raises(type(error)) as caught, damage_refused(refused):
        raise error
    assert caught.value is error


def test_a_machine_without_files_to_open_damages_none(tmp_path):
    resource = pytest.importorskip("resource")
    rows = {"x": np.zeros(3)}
    write_artifact(tmp_path / "a", "k", rows, units={"x": "m"}, data="synthetic")
    save_checkpoint(tmp_path / "c", rows)
    ArrayFile.at(tmp_path / "y.npy", (3,), np.float64).write(0, np.ones(3))
    motion = ROOT / "bridge" / "motion" / "samples" / "walking.npz"
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, before[1]))
    try:
        for work in (
            lambda: read_artifact(tmp_path / "a"),
            lambda: load_checkpoint(tmp_path / "c"),
            lambda: ArrayFile.at(tmp_path / "y.npy", (3,), np.float64),
            lambda: read_motion_file(motion),
        ):
            with pytest.raises(OSError, match="Too many open files"):
                work()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert (ArrayFile.at(tmp_path / "y.npy", (3,), np.float64).read(slice(3)) == 1).all()


def handlers_of_anything(path: Path) -> list[str]:
    """Where a file catches `Exception`, or all, and goes on."""
    handlers = [node for node in ast.walk(parsed(path)) if isinstance(node, ast.ExceptHandler)]
    broad = [
        one
        for one in handlers
        if one.type is None or {"Exception", "BaseException"} & set(ast.unparse(one.type).split())
    ]
    return [
        f"{path.relative_to(ROOT).as_posix()}:{one.lineno}"
        for one in broad
        if not (isinstance(one.body[-1], ast.Raise) and one.body[-1].exc is None)
    ]


def test_nobody_else_says_what_damage_is():
    found = [place for path in source_files(*PACKAGES) for place in handlers_of_anything(path)]
    assert {place.split(":")[0] for place in found} <= ANSWERS_FOR_WORK | {
        "bridge/runs/workers.py",
        "bridge/plugins.py",
    }


def test_nobody_lets_numpy_parse_a_header():
    parsing = ("np.load(", "read_array(", "read_array_header", "NpzFile", "literal_eval")
    texts = {path: path.read_text(encoding="utf-8") for path in source_files(*PACKAGES)}
    found = {path for path, text in texts.items() if any(word in text for word in parsing)}
    assert not found


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
        map_npy(path)


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
