"""Files and folders that come into place whole, that one process at a time writes, and digests.

An artifact grows in `.<name>.partial` beside its folder. Once a manifest lies there it is complete:
`settle` puts it into place, now or, after a kill at any moment, when the folder is next asked for.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from bridge.errors import DsnetError
from bridge.runs.untrusted import is_of_the_machine, map_npy

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None

MANIFEST = "manifest.json"
CHECKPOINTS = "checkpoints"
_flush_data = getattr(os, "fdatasync", os.fsync)
# A file system's clock ticks every few ms: what was changed just now may change again unseen.
_SETTLED_NS = 50_000_000
_known: dict[Path, tuple[list[int], str]] = {}


def runs_root() -> Path:
    """`runs/` below the working directory, or what `DSNET_RUNS` names."""
    return Path(os.environ.get("DSNET_RUNS", "runs"))


def is_finished(folder: Path) -> bool:
    return (folder / MANIFEST).is_file()


def write_text_atomically(path: Path, text: str) -> None:
    """Write `text` beside `path` and rename it into place."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    partial.write_text(text, encoding="utf-8", newline="\n")  # the same bytes on Windows
    os.replace(partial, path)


def partial_folder(folder: Path) -> Path:
    """Where the artifact `folder` is while it is being written."""
    return folder.with_name(f".{folder.name}.partial")


def is_unsettled(folder: Path) -> bool:
    """Whether a process that was killed left something for `settle` to do."""
    return is_finished(partial_folder(folder)) or (folder / CHECKPOINTS).exists()


def settle(folder: Path) -> None:
    """Put a complete partial folder into place and remove what it replaces.

    Each step leaves a state from which the next call goes on, and one of the old and the new
    artifact is there throughout. Only the process that may write `folder` may call it.
    """
    partial = partial_folder(folder)
    if is_finished(partial):
        shutil.rmtree(partial / CHECKPOINTS, ignore_errors=True)
        # A folder cannot be renamed over a full one, so the old one steps aside first.
        if folder.exists():
            folder.rename(partial / CHECKPOINTS)
        partial.rename(folder)
    shutil.rmtree(folder / CHECKPOINTS, ignore_errors=True)


def lock_of(folder: Path) -> Path:
    """The file whose lock keeps others out of `folder`."""
    return folder.with_name(f".{folder.name}.lock")


@contextmanager
def exclusive(folder: Path, what: str, remedy: str) -> Iterator[None]:
    """Keep other processes out of `folder`, which need not exist yet, or be refused.

    The refusal names `what`, such as "stage 'align' of run 'demo'", and the remedy. The system lets
    go when a process is killed; the lock, a file beside the folder, goes with the next one.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    path = lock_of(folder)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if not _locked(descriptor, path):
            raise DsnetError(
                f"{what}, which another process is making", "one process at a time", remedy
            )
        try:
            yield
        finally:
            if fcntl is not None:
                path.unlink(missing_ok=True)
    finally:
        os.close(descriptor)
        if fcntl is None:  # on Windows an open file stays, also one that another has opened since
            with suppress(OSError):
                path.unlink()


def _locked(descriptor: int, path: Path) -> bool:
    try:
        if fcntl is None:
            from filelock import lock_descriptor

            return lock_descriptor(descriptor, blocking=False)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Whom it belonged to may have removed the file since it was opened.
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except (BlockingIOError, FileNotFoundError):
        return False


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, read in blocks."""
    with open(path, "rb") as stream:
        digest = hashlib.sha256()
        while block := stream.read(1 << 22):
            digest.update(block)
    return digest.hexdigest()


def stamp_of(path: Path) -> list[int] | None:
    """Size, times and inode, by which a file's content is known again; None if just changed."""
    found = path.stat()
    if time.time_ns() - max(found.st_mtime_ns, found.st_ctime_ns) < _SETTLED_NS:
        return None
    return [found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino]


def sha256_of(path: Path) -> str:
    """As `file_sha256`; this process reads a file that stays the same only once."""
    stamp = stamp_of(path)
    known, digest = _known.get(path, (None, ""))
    if stamp is None or known != stamp:
        digest = file_sha256(path)
        if stamp is not None:
            _known[path] = stamp, digest
    return digest


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
    """Whether `mark` was left for what is there now, whose digest is asked for only then."""
    return mark.is_file() and mark.read_bytes() == digest().encode()


def save_array(path: Path, array: ArrayLike) -> None:
    """Write a whole array; a full disk is an OSError that says so."""
    with open(path, "wb") as stream:
        # Into what it takes for a file, NumPy does not say why it could not write all.
        anything: Any = SimpleNamespace(write=stream.write)
        np.save(anything, np.ascontiguousarray(array), allow_pickle=False)


def map_array(path: Path, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Memory-map an array for writing: the one that is there if it is such a one, or a new one.

    Room for all of a new one is taken before it is mapped: a mapped file without room kills the
    process without a word (SIGBUS) when it is written to.
    """
    try:
        found = map_npy(path, "r+")
        if (found.shape, found.dtype) == (shape, np.dtype(dtype)):
            return found
    except (OSError, ValueError) as error:  # none, or a damaged one
        if is_of_the_machine(error):
            raise
    # Under its name only when it is whole, or a killed stage would go on with half of it.
    new = path.with_suffix(".new")
    np.lib.format.open_memmap(new, mode="w+", dtype=np.dtype(dtype), shape=shape)  # reads nothing
    try:
        if hasattr(os, "posix_fallocate"):  # Linux; elsewhere a full disk may end the process
            with open(new, "r+b") as stream:
                os.posix_fallocate(stream.fileno(), 0, new.stat().st_size)
    except OSError as error:
        new.unlink()
        raise OSError(error.errno, error.strerror, str(new)) from error
    new.replace(path)
    return map_npy(path, "r+")


@dataclass(frozen=True)
class ArrayFile:
    """An `.npy` file that processes fill together, on any machine that sees its absolute path.

    Pieces are written at their place in the file, not through memory maps: of a page that two
    machines have mapped the later one to write it back wins whole.
    """

    path: Path
    shape: tuple[int, ...]
    dtype: str
    header_bytes: int

    def read(self, rows: slice) -> NDArray[Any]:
        return np.array(np.memmap(self.path, self.dtype, "r", self.header_bytes, self.shape)[rows])

    def write(self, start: int, rows: ArrayLike) -> None:
        """Store rows (n, ...) from row `start` on; they are on the disk when this returns."""
        values = np.ascontiguousarray(rows, self.dtype)
        if values.shape[1:] != self.shape[1:] or not 0 <= start <= self.shape[0] - len(values):
            raise ValueError(f"rows {start} of shape {values.shape} for {self.path} {self.shape}")
        row_bytes = values.dtype.itemsize * int(np.prod(self.shape[1:], dtype=np.int64))
        left = values.reshape(-1).view(np.uint8).data
        with open(self.path, "r+b", buffering=0) as file:
            file.seek(self.header_bytes + start * row_bytes)
            while left:
                left = left[file.write(left) :]
            _flush_data(file.fileno())
