"""Files that come from strangers: opened without waiting, read within bounds.

Whatever a file declares (the size of a directory, an array's shape, a type) is compared with what
it may be before anything is allocated for it. Readers turn the errors here into their own.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import stat
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from numpy.typing import NDArray

from bridge.runs.npy_file import NpyHeader, read_npy

_DIRECTORY_BYTES = 1 << 20
"""Of an archive: what stands in it of 10,000 members."""
MOST_JSON_BYTES = 32 << 20
"""Of a manifest: what `evaluate` says of some 2,300 sequences by seven predictors. As lists in
lists so many bytes take 0.7 GB of memory."""
_WITHOUT_WAIT = getattr(os, "O_NONBLOCK", 0)
"""Windows has no pipes among its files."""
_PLAIN_NAME = re.compile(r"[^/\\\0]{1,255}(/[^/\\\0]{1,255}){0,7}")


class ForeignFile(io.BufferedReader):
    """A file that is never asked for more bytes at once than it may have of its own account."""

    largest_read: float = math.inf

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file; ValueError where `size` is larger than `largest_read`."""
        if size is not None and size > self.largest_read:
            raise ValueError(f"{size} bytes at once, not at most {self.largest_read:.0f}")
        return super().read(size)


def open_regular(path: Path | str, most_bytes: float = math.inf) -> ForeignFile:
    """Open a regular file for reading; pipes, sockets and devices are refused at once.

    Raises
    ------
    OSError
        If it is none, or cannot be opened.
    ValueError
        If it is larger than `most_bytes`, or the path is none.
    """
    if stat.S_ISDIR(mode := Path(path).stat().st_mode):
        raise IsADirectoryError(f"{path} is a folder")
    if not stat.S_ISREG(mode):
        raise OSError(f"{path} is a pipe, a socket or a device")
    # A pipe that took the file's place since would keep us waiting for a writer.
    stream = ForeignFile(io.FileIO(path, opener=lambda p, flags: os.open(p, flags | _WITHOUT_WAIT)))
    stream.largest_read = os.fstat(stream.fileno()).st_size
    if stream.largest_read > most_bytes:
        stream.close()
        raise ValueError(f"a file of {stream.largest_read} bytes, not at most {most_bytes:.0f}")
    return stream


def read_json(path: Path) -> Any:
    """The value in a JSON file.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is too large, nested too deeply or not JSON.
    """
    with open_regular(path, MOST_JSON_BYTES) as stream:
        try:
            return json.loads(stream.read().decode())
        except RecursionError as error:
            raise ValueError("nested too deeply") from error


def is_plain_name(name: object) -> bool:
    """Whether a file's name stays inside the folder that it is looked for in."""
    if not isinstance(name, str) or not _PLAIN_NAME.fullmatch(name) or not name.isprintable():
        return False
    if os.name == "nt" and ":" in name:  # a drive, or a second stream of a file
        return False
    return not {".", ".."} & set(name.split("/"))


def text_of(array: NDArray[Any]) -> str:
    """The text in an array of one element.

    NumPy takes any number for a character, and Python fails on those that are none: they become
    U+FFFD.
    """
    if array.dtype.kind == "U":
        little = array.astype(array.dtype.newbyteorder("<")).tobytes()
        return little.decode("utf-32-le", errors="replace").rstrip("\0")
    value = array.item()
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


class ForeignNpz(Mapping[str, NpyHeader]):
    """An `.npz` whose members are known by their headers until they are asked for."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._members = {
            info.filename.removesuffix(".npy"): info
            for info in archive.infolist()
            if info.filename.endswith(".npy") and is_plain_name(info.filename)
        }

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def __getitem__(self, name: str) -> NpyHeader:
        with self.member(name) as stream:
            return NpyHeader.read(stream)

    @contextmanager
    def member(self, name: str) -> Iterator[IO[bytes]]:
        """The bytes of one member, as NumPy stores it: as they are, or deflated.

        Other kinds of compression declare how much memory they need.

        Raises
        ------
        ValueError
            If it is compressed otherwise.
        """
        info = self._members[name]
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name!r} compressed in another way than NumPy's")
        with self._archive.open(info) as stream:
            yield stream

    def check(self, name: str, most_bytes: float) -> None:
        """Refuse a member that is neither numbers nor text, or is too large in memory.

        Raises
        ------
        ValueError
            If it is.
        """
        header = self[name]
        if header.dtype.kind not in "biufcSU":
            raise ValueError(f"{name!r} is an array of {str(header.dtype)[:40]}")
        if header.size_bytes > most_bytes:
            size = f"{header.size_bytes} bytes in shape {header.shape}"
            raise ValueError(f"{name!r} is of {size}, not at most {most_bytes:.0f} bytes")

    def array(self, name: str) -> NDArray[Any]:
        """One array; `check` it before.

        Raises
        ------
        Exception
            Any of `bridge.runs.damage`, if it is damaged or an array of objects.
        """
        with self.member(name) as stream:
            return read_npy(stream)


@contextmanager
def open_npz(path: Path | str, most_bytes: float = math.inf) -> Iterator[ForeignNpz]:
    """Open an `.npz`; nothing of it is read but its directory.

    Raises
    ------
    Exception
        Any of `bridge.runs.damage`, if the file is none; see also `open_regular`.
    """
    with open_regular(path, most_bytes) as stream:
        # zipfile believes the size that an archive declares for its directory.
        whole, stream.largest_read = stream.largest_read, _DIRECTORY_BYTES
        with zipfile.ZipFile(stream) as archive:
            stream.largest_read = whole
            yield ForeignNpz(archive)
