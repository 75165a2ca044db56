"""Files and folders that come into place whole, that one process at a time writes, and digests.

What will be `NAME` is made in the folder `.NAME.partial` beside it, and renamed when it is whole.
All else goes with that folder, also what a killed process left there.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from bridge.errors import DsnetError, InterruptedWorkError
from bridge.runs.untrusted import is_of_the_machine, map_npy

MANIFEST = "manifest.json"
_LOCK = "lock"
# A file system's clock ticks every few ms: what was changed just now may change again unseen.
_SETTLED_NS = 50_000_000


def runs_root() -> Path:
    """`runs/` below the working directory, or what `DSNET_RUNS` names."""
    return Path(os.environ.get("DSNET_RUNS", "runs"))


def is_finished(folder: Path) -> bool:
    return (folder / MANIFEST).is_file()


@contextmanager
def written_whole(path: Path, *, alone: bool = False) -> Iterator[Path]:
    """Where to write a file that is renamed to `path` at the end, so that no reader meets half.

    `alone`: no other process writes it, so what a killed one left is written over.
    """
    writer = "" if alone else f".{os.getpid()}"
    partial = path.with_name(f".{path.name}{writer}.partial")
    try:
        yield partial
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def write_text_atomically(path: Path, text: str) -> None:
    """Write `text` beside `path` and rename it into place."""
    with written_whole(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")  # the same bytes on Windows


def work_folder(path: Path) -> Path:
    """Where what will be `path` is made."""
    return path.with_name(f".{path.name}.partial")


def remove_work(path: Path) -> None:
    """Remove what lies in the work folder of `path`, and that folder if nobody holds its lock."""
    work = work_folder(path)
    for one in work.iterdir() if work.is_dir() else ():
        if one.is_dir() and not one.is_symlink():
            shutil.rmtree(one, ignore_errors=True)
        elif one.name != _LOCK:
            one.unlink(missing_ok=True)
    with suppress(OSError):
        work.rmdir()


@contextmanager
def exclusive(path: Path, what: str, remedy: str, *, resumed: bool = False) -> Iterator[Path]:
    """The work folder of `path`, which need not exist yet, for one process; others are refused.

    The refusal names `what`, such as "stage 'align' of run 'demo'", and the remedy. The folder is
    empty, and goes at the end; where work is `resumed`, it is as a process left it that was killed,
    and stays when anything but a refusal ends the block.
    """
    work = work_folder(path)
    work.mkdir(parents=True, exist_ok=True)
    with ExitStack() as opened:
        if not _is_taken(work / _LOCK, opened):
            received = f"{what}, which another process is making"
            raise DsnetError(received, "one process at a time", remedy)
        try:
            if not resumed:
                remove_work(path)
            yield work
        except BaseException as error:
            refused = isinstance(error, DsnetError) and not isinstance(error, InterruptedWorkError)
            if refused or not resumed:
                _leave(path)
            raise
        _leave(path)


def tidy(path: Path) -> None:
    """Remove what a process left beside `path` that was killed when it was made; what one is at
    that is alive stays."""
    if work_folder(path).exists():
        with suppress(DsnetError, OSError), exclusive(path, "", ""):
            pass


def _is_taken(path: Path, opened: ExitStack) -> bool:
    """Whether this process has a lock from now on; the system lets go when the process ends."""
    # It brings asyncio, which whoever only reads runs or predicts in memory need not load.
    from filelock import lock_descriptor

    try:
        lock = opened.enter_context(path.open("ab"))
        # Whom it belonged to may have removed the file since it was opened.
        return lock_descriptor(lock.fileno(), blocking=False) and os.path.samestat(
            os.fstat(lock.fileno()), path.stat()
        )
    except FileNotFoundError:
        return False


def _leave(path: Path) -> None:
    """The lock goes last: whoever takes it finds an empty folder."""
    remove_work(path)
    with suppress(OSError):  # Windows keeps what is open
        (work_folder(path) / _LOCK).unlink()
        work_folder(path).rmdir()


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, read in blocks."""
    with open(path, "rb") as stream:
        digest = hashlib.sha256()
        while block := stream.read(1 << 22):
            digest.update(block)
    return digest.hexdigest()


def stamp_of(path: Path) -> list[int] | None:
    """Size, times and inode, by which a file's content is known again; None if just changed."""
    status = path.stat()
    if time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) < _SETTLED_NS:
        return None
    return [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]


def sha256_of(path: Path) -> str:
    """As `file_sha256`; this process reads a file that stays the same only once."""
    stamp = stamp_of(path)
    return file_sha256(path) if stamp is None else _known_sha256(path, *stamp)


@cache
def _known_sha256(path: Path, *_stamp: int) -> str:
    return file_sha256(path)


def json_sha256(value: Any) -> str:
    """SHA-256 of a JSON value in canonical form (sorted keys, no spaces)."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def arrays_sha256(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of named arrays: names, shapes, types and values."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(json.dumps([name, array.shape, array.dtype.str]).encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def mark_written(mark: Path, digest: str) -> None:
    """Leave a checkpoint that says: what has this digest is written."""
    write_text_atomically(mark, digest)


def is_written(mark: Path, digest: Callable[[], str]) -> bool:
    """Whether `mark` was left for what is there now, whose digest is computed only then."""
    return mark.is_file() and mark.read_bytes() == digest().encode()


@dataclass(frozen=True)
class ArrayFile:
    """An `.npy` file that processes fill together, on any machine that sees its absolute path.

    Pieces are written at their place in the file, not through memory maps: of a page that two
    machines have mapped the later one to write it back wins whole, and a mapped file without room
    on the disk kills the process without a word.
    """

    path: Path
    shape: tuple[int, ...]
    dtype: str
    header_bytes: int

    @classmethod
    def at(cls, path: Path, shape: tuple[int, ...], dtype: DTypeLike) -> ArrayFile:
        """The array that is there if it is such a one, or a new one of zeros.

        Room for all of a new one is taken at once, so that a full disk is an error before the work.
        """
        path, wanted = path.resolve(), np.dtype(dtype)
        try:
            array = map_npy(path)
            if (array.shape, array.dtype) != (shape, wanted):
                raise ValueError("another array")
        except (OSError, ValueError) as error:  # or none, or a damaged one
            if is_of_the_machine(error):
                raise
            _begin_array(path, shape, wanted)
            array = map_npy(path)
        # Without an element there is no map, and nothing will be written.
        return cls(path, shape, wanted.str, getattr(array, "offset", 0))

    def read(self, rows: slice) -> NDArray[Any]:
        return np.array(map_npy(self.path)[rows])

    def write(self, start: int, rows: ArrayLike) -> None:
        """Store rows (n, ...) from row `start` on."""
        values = np.ascontiguousarray(rows, self.dtype)
        if values.shape[1:] != self.shape[1:] or not 0 <= start <= self.shape[0] - len(values):
            raise ValueError(f"rows {start} of shape {values.shape} for {self.path} {self.shape}")
        row_bytes = values.dtype.itemsize * int(np.prod(self.shape[1:], dtype=np.int64))
        left = values.reshape(-1).view(np.uint8).data
        with open(self.path, "r+b", buffering=0) as file:
            file.seek(self.header_bytes + start * row_bytes)
            while left:
                left = left[file.write(left) :]


def _begin_array(path: Path, shape: tuple[int, ...], dtype: np.dtype) -> None:
    """Under its name only when it is whole, or a killed stage would go on with half of it."""
    header = {"descr": dtype.str, "fortran_order": False, "shape": shape}
    new = path.with_suffix(".new")
    with open(new, "wb", buffering=0) as stream:
        np.lib.format.write_array_header_1_0(stream, header)
        size = stream.tell() + dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        stream.truncate(size)
        if hasattr(os, "posix_fallocate"):  # Linux
            try:
                os.posix_fallocate(stream.fileno(), 0, size)
            except OSError as error:
                raise OSError(error.errno, error.strerror, str(new)) from error
    os.replace(new, path)
