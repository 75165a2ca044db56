"""Arrays on disk that grow in pieces: room for all of one is taken before it is mapped.

A mapped file without room kills the process without a word (SIGBUS) when it is written to.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from bridge.runs.damage import is_of_the_machine
from bridge.runs.folders import write_text_atomically
from bridge.runs.foreign_files import open_regular
from bridge.runs.npy_file import NpyHeader

_BLOCK_BYTES = 1 << 22


def save_array(path: Path, array: ArrayLike) -> None:
    """Write a whole array; a full disk is an OSError that says so."""
    with open(path, "wb") as stream:
        # Into what it takes for a file, NumPy does not say why it could not write all.
        anything: Any = SimpleNamespace(write=stream.write)
        np.save(anything, np.ascontiguousarray(array), allow_pickle=False)


def map_array(path: Path, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Memory-map an array for writing: the one that is there if it is such a one, or a new one."""
    found = _mapped(path)
    if found is not None and (found.shape, found.dtype) == (shape, np.dtype(dtype)):
        return found
    # Under its name only when it is whole, or a killed stage would go on with half of it.
    new = path.with_suffix(".new")
    np.lib.format.open_memmap(new, mode="w+", dtype=np.dtype(dtype), shape=shape)  # reads nothing
    _take_room(new)
    new.replace(path)  # while nobody has it mapped: Windows refuses else
    return map_npy(path, "r+")


def map_npy(path: Path, mode: Literal["r", "r+"] = "r") -> NDArray[Any]:
    """Memory-map the array of a `.npy`; one without elements has no map.

    Raises
    ------
    OSError, ValueError
        If the file is none, or ends before its array does.
    """
    with open_regular(path) as stream:
        header, begins = NpyHeader.read(stream), stream.tell()
        if header.dtype.hasobject or stream.largest_read < begins + header.size_bytes:
            raise ValueError(f"no {header.dtype} of shape {header.shape} in it")
    if not math.prod(header.shape):
        return np.empty(header.shape, header.dtype)
    return np.memmap(path, header.dtype, mode, begins, header.shape, header.order)


def _mapped(path: Path) -> NDArray[Any] | None:
    try:
        return map_npy(path, "r+")
    except (OSError, ValueError) as error:  # none, or a damaged one
        if is_of_the_machine(error):
            raise
        return None


def _take_room(path: Path) -> None:
    try:
        with open(path, "r+b") as stream:
            _fill(stream, path.stat().st_size)
    except OSError as error:
        path.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error


def _fill(stream: BinaryIO, size: int) -> None:
    """Have a place on the disk for each of the bytes of a file that holds zeros after a header."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(stream.fileno(), 0, size)
        return
    # macOS and Windows: a place is given to what is written.
    for start in range(0, size, _BLOCK_BYTES):
        stream.seek(start)
        block = stream.read(_BLOCK_BYTES)
        stream.seek(start)
        stream.write(block)
    stream.flush()
    os.fsync(stream.fileno())


def mark_written(mark: Path, digest: str) -> None:
    """Leave a checkpoint that says: what has this digest is written."""
    write_text_atomically(mark, digest)


def is_written(mark: Path, digest: Callable[[], str]) -> bool:
    """Whether `mark` was left for what is there now, whose digest is asked for only then."""
    return mark.is_file() and mark.read_bytes() == digest().encode()
