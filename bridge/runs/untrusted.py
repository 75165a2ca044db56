"""Files from unknown sources: opened without waiting, read within bounds, nothing executed.

Whatever a file declares (the size of a directory, an array's shape, a type) is compared with what
it may be before anything is allocated for it. Readers turn the errors here into their own.
"""

from __future__ import annotations

import errno
import io
import json
import math
import os
import pickle
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError

DAMAGE = (
    ArithmeticError,
    AttributeError,
    BufferError,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    pickle.PickleError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
"""What a damaged or hostile file can cause. Nothing else is a reason to advise against a file: an
error of the interpreter, the installation or the machine says nothing of what was being read."""
_OF_THE_MACHINE = frozenset(
    {errno.EACCES, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EPERM}
)
_DIRECTORY_BYTES = 1 << 20
"""Of an archive: what stands in it of 10,000 members."""
MOST_JSON_BYTES = 32 << 20
"""Of a manifest: what `evaluate` says of some 2,300 sequences by seven predictors. As lists in
lists so many bytes take 0.7 GB of memory."""
_WITHOUT_WAIT = getattr(os, "O_NONBLOCK", 0)
_PLAIN_NAME = re.compile(r"[^/\\\0]{1,255}(/[^/\\\0]{1,255}){0,7}")


@contextmanager
def damage_refused(
    refusal: Callable[[Exception], DsnetError], *libraries: type[Exception]
) -> Iterator[None]:
    """Turn what a damaged file can cause into a refusal of it; let all else pass.

    `libraries` are exceptions that the file's reader defines; `RecursionError` where it follows
    what the file nests.
    """
    try:
        yield
    except (*DAMAGE, *libraries) as error:
        ours = isinstance(error, RecursionError) and RecursionError not in libraries
        if ours or is_of_the_machine(error):
            raise
        raise refusal(error) from error


def file_refused(
    path: Path,
    refused: Callable[[Path, str, str], DsnetError],
    remedy: str,
    *,
    missing: str = "Check the path.",
) -> AbstractContextManager[None]:
    """`damage_refused` of a reader's file: `refused` makes the line of path, flaw and remedy."""

    def refusal(error: Exception) -> DsnetError:
        if isinstance(error, FileNotFoundError):
            return refused(path, "which does not exist", missing)
        if isinstance(error, IsADirectoryError):
            return refused(path, "which is a folder", "Name one file in it.")
        return refused(path, f"which does not load ({str(error)[:200]})", remedy)

    return damage_refused(refusal, RecursionError)


def is_of_the_machine(error: Exception) -> bool:
    """Whether the system refused to read a file, whatever is in it."""
    return isinstance(error, OSError) and error.errno in _OF_THE_MACHINE


class UntrustedFile(io.BufferedReader):
    """A file of which no read asks for more bytes than it holds."""

    largest_read: float = math.inf

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > self.largest_read:
            raise ValueError(f"{size} bytes at once, not at most {self.largest_read:.0f}")
        return super().read(size)


def open_regular(path: Path | str, most_bytes: float = math.inf) -> UntrustedFile:
    """Open a regular file of at most so many bytes; pipes, sockets and devices are refused."""
    # Nobody writes into a pipe for us to wait for.
    file = io.FileIO(path, opener=lambda p, flags: os.open(p, flags | _WITHOUT_WAIT))
    stream, status = UntrustedFile(file), os.fstat(file.fileno())
    if not stat.S_ISREG(status.st_mode):
        stream.close()
        raise OSError(f"{path} is a pipe, a socket or a device")
    stream.largest_read = status.st_size
    if stream.largest_read > most_bytes:
        stream.close()
        raise ValueError(f"a file of {stream.largest_read} bytes, not at most {most_bytes:.0f}")
    return stream


def inflated(file: IO[bytes], most_bytes: int) -> io.BytesIO:
    """What zlib or gzip made smaller, of at most so many bytes."""
    unpacking = zlib.decompressobj(wbits=32 + zlib.MAX_WBITS)
    whole = unpacking.decompress(file.read(), most_bytes)
    if not unpacking.eof:
        raise ValueError(f"compressed data that end early, or of more than {most_bytes} bytes")
    return io.BytesIO(whole)


def read_json(path: Path) -> Any:
    """The value in a JSON file; OSError or ValueError where there is none."""
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
    """The text in an array of one element; what is no character in it becomes U+FFFD.

    NumPy takes any number for a character, and Python fails on those that are none.
    """
    if array.dtype.kind == "U":
        little = array.astype(array.dtype.newbyteorder("<")).tobytes()
        return little.decode("utf-32-le", errors="replace").rstrip("\0")
    value = array.item()
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


_WIDTHS = {b"\x93NUMPY\1\0": 2, b"\x93NUMPY\2\0": 4, b"\x93NUMPY\3\0": 4}
"""Bytes that say how long the header is, by magic and version."""
_LONGEST_HEADER = 10_000
_BLOCK_BYTES = 1 << 20
# In any order, as other writers have it; Python 2 wrote `10L`.
_HEADER = re.compile(
    rb"\{(?:\s*(?:"
    rb"(['\"])descr\1\s*:\s*(['\"])(?P<descr>[<>|=][biufcSUVOMm][0-9]*(?:\[[0-9a-zA-Z]+\])?)\2|"
    rb"(['\"])fortran_order\4\s*:\s*(?P<fortran>True|False)|"
    rb"(['\"])shape\6\s*:\s*\((?P<shape>(?:\s*[0-9]{1,19}L?\s*,)*\s*(?:[0-9]{1,19}L?\s*)?)\)"
    rb")\s*(?:,|(?=\}))){3}\s*\}\s*"
)


@dataclass(frozen=True)
class NpyHeader:
    """What a `.npy` declares of its array, in memory of `size_bytes`.

    NumPy reads it as Python source. CPython 3.11 counts the depth of a syntax tree for all threads
    together, so there a whole file's header fails now and then when threads read at once.
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    order: Literal["C", "F"] = "C"
    """`F` where the first index runs fastest."""

    @classmethod
    def read(cls, stream: IO[bytes]) -> NpyHeader:
        """From the beginning of a file; the stream is left where the data begin."""
        width = _WIDTHS.get(stream.read(8), 0)
        length = int.from_bytes(stream.read(width), "little")
        text = stream.read(length) if length <= _LONGEST_HEADER else b""
        match = _HEADER.fullmatch(text)
        flaw = ValueError(f"a header that is none of a .npy ({text[:80]!r})")
        if match is None or None in (match["descr"], match["fortran"], match["shape"]):
            raise flaw
        sizes = (size.strip(b" L") for size in match["shape"].split(b","))
        try:
            dtype = np.dtype(match["descr"].decode())
        except (TypeError, OverflowError) as error:
            raise flaw from error
        order = "F" if match["fortran"] == b"True" else "C"
        return cls(tuple(int(size) for size in sizes if size), dtype, order)

    @property
    def size_bytes(self) -> int:
        return math.prod(self.shape) * max(self.dtype.itemsize, 1)


def read_npy(stream: IO[bytes]) -> NDArray[Any]:
    """The array in a stream that may be of any kind; objects are refused, never unpickled."""
    header = NpyHeader.read(stream)
    if header.dtype.hasobject:
        raise ValueError("an array of Python objects")
    data = bytearray(header.size_bytes)
    left = memoryview(data)
    while left:
        block = stream.read(min(len(left), _BLOCK_BYTES))
        if not block:
            raise ValueError(f"an array without its last {len(left)} bytes")
        left[: len(block)] = block
        left = left[len(block) :]
    return np.ndarray(header.shape, header.dtype, data, order=header.order)


def map_npy(path: Path) -> NDArray[Any]:
    """Memory-map the array of a `.npy`, all of which must be there; an empty one has no map."""
    with open_regular(path) as stream:
        header, begins = NpyHeader.read(stream), stream.tell()
        if header.dtype.hasobject or stream.largest_read < begins + header.size_bytes:
            raise ValueError(f"no {header.dtype} of shape {header.shape} in it")
    if not math.prod(header.shape):
        return np.empty(header.shape, header.dtype)
    return np.memmap(path, header.dtype, "r", begins, header.shape, header.order)


class UntrustedNpz:
    """An `.npz` of whose members only the headers are read until `array` is called."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self.others = [n for n in archive.namelist() if not n.endswith(".npy")]
        self._members = {
            info.filename.removesuffix(".npy"): info
            for info in archive.infolist()
            if info.filename.endswith(".npy") and is_plain_name(info.filename)
        }

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def __len__(self) -> int:
        return len(self._members)

    def __getitem__(self, name: str) -> NpyHeader:
        with self.member(name) as stream:
            return NpyHeader.read(stream)

    @contextmanager
    def member(self, name: str) -> Iterator[IO[bytes]]:
        """The bytes of one member, as NumPy stores it: as they are, or deflated.

        Other kinds of compression, which declare how much memory they need, are a ValueError.
        """
        info = self._members[name]
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name!r} compressed in another way than NumPy's")
        with self._archive.open(info) as stream:
            yield stream

    def check(self, name: str, most_bytes: float) -> None:
        """Refuse a member that is neither numbers nor text, or is too large in memory."""
        header = self[name]
        if header.dtype.kind not in "biufcSU":
            raise ValueError(f"{name!r} is an array of {str(header.dtype)[:40]}")
        if header.size_bytes > most_bytes:
            size = f"{header.size_bytes} bytes in shape {header.shape}"
            raise ValueError(f"{name!r} is of {size}, not at most {most_bytes:.0f} bytes")

    def array(self, name: str) -> NDArray[Any]:
        """One array; `check` it before."""
        with self.member(name) as stream:
            return read_npy(stream)


@contextmanager
def open_npz(path: Path | str, most_bytes: float = math.inf) -> Iterator[UntrustedNpz]:
    """Open an `.npz`; nothing of it is read but its directory."""
    with open_regular(path, most_bytes) as stream:
        # zipfile believes the size that an archive declares for its directory.
        whole, stream.largest_read = stream.largest_read, _DIRECTORY_BYTES
        with zipfile.ZipFile(stream) as archive:
            stream.largest_read = whole
            yield UntrustedNpz(archive)
