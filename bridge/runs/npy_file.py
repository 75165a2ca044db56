"""The header of a `.npy`, and the array after it, read without executing or parsing Python.

NumPy reads the header as Python source. CPython 3.11 counts the depth of a syntax tree for all
threads together, so there a whole file's header fails now and then when threads read at once.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

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
    """What a `.npy` declares of its array."""

    shape: tuple[int, ...]
    dtype: np.dtype
    order: Literal["C", "F"] = "C"
    """`F` where the first index runs fastest."""

    @classmethod
    def read(cls, stream: IO[bytes]) -> NpyHeader:
        """From the beginning of a file; the stream is left where the data begin.

        Raises
        ------
        ValueError
            If it is no header of such a file, or of records.
        """
        text = _text(stream)
        found = _HEADER.fullmatch(text)
        flaw = ValueError(f"a header that is none of a .npy ({text[:80]!r})")
        if found is None or None in (found["descr"], found["fortran"], found["shape"]):
            raise flaw
        sizes = (size.strip(b" L") for size in found["shape"].split(b","))
        try:
            dtype = np.dtype(found["descr"].decode())
        except (TypeError, OverflowError) as error:
            raise flaw from error
        order = "F" if found["fortran"] == b"True" else "C"
        return cls(tuple(int(size) for size in sizes if size), dtype, order)

    @property
    def size_bytes(self) -> int:
        """Of the array in memory."""
        return math.prod(self.shape) * max(self.dtype.itemsize, 1)


def _text(stream: IO[bytes]) -> bytes:
    """Nothing where there is none of a length that it may have."""
    width = _WIDTHS.get(stream.read(8), 0)
    length = int.from_bytes(stream.read(width), "little")
    return stream.read(length) if length <= _LONGEST_HEADER else b""


def read_npy(stream: IO[bytes]) -> NDArray[Any]:
    """The array in a stream that may be of any kind; objects are refused, never unpickled.

    Raises
    ------
    ValueError
        If it is none, or ends before its array does.
    """
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
