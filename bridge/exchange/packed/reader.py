"""Reading packed files that anybody may have written."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.packed.codec import MOST_PLANES, CodedFrames, decode
from bridge.exchange.packed.layout import ABOUT, FORMAT, Bounded, block_name
from bridge.runs.artifact import DataOrigin
from bridge.runs.damage import damage_refused
from bridge.runs.digests import arrays_sha256, json_sha256
from bridge.runs.foreign_files import ForeignNpz, is_plain_name, open_npz

_ABOUT_BYTES = 64 << 20
_MOST_INFLATION = 5000
"""Deflate gives at most 1032 bytes for one, and a byte is at least one number of four."""


class PackedFile:
    """An open packed file; nothing is decoded before it is asked for."""

    def __init__(self, path: Path, archive: ForeignNpz) -> None:
        self._path, self._archive = path, archive
        archive.check(ABOUT, _ABOUT_BYTES)
        about = json.loads(str(archive.array(ABOUT)))
        self.facts: dict[str, Any] = about["content"]
        """What the file says of itself."""
        if self.facts["format"] != FORMAT or about["sha256"] != json_sha256(self.facts):
            raise ValueError("not what was written, or of another version")
        if self.facts["data"] not in ("synthetic", "licensed"):
            raise ValueError("data that are neither synthetic nor licensed")
        self.bounded = {name: Bounded.of(one) for name, one in self.facts["bounded"].items()}
        """Arrays of vertices, by name."""
        self.exact: dict[str, str] = {n: str(e["unit"]) for n, e in self.facts["exact"].items()}
        """Units of all other arrays."""
        self._check_sizes()

    @property
    def origin(self) -> DataOrigin:
        """`synthetic` or `licensed`."""
        return self.facts["data"]

    def blocks(self, name: str) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """The first frame, and the frames (n, V, 3), of block after block.

        Raises
        ------
        DsnetError
            If one is damaged.
        """
        entry = self.bounded[name]
        for index, start in enumerate(entry.blocks()):
            with _damage_named(self._path):
                yield start, self._block(name, entry, index, start)

    def array(self, name: str) -> NDArray[Any]:
        """One array, whole; errors as `blocks`."""
        if name in self.bounded:
            found = np.empty(self.bounded[name].shape, np.float32)
            for start, frames in self.blocks(name):
                found[start : start + len(frames)] = frames
            return found
        with _damage_named(self._path):
            return self._member(name)

    def _block(self, name: str, entry: Bounded, index: int, start: int) -> NDArray[np.float32]:
        member, shape = block_name(name, index), entry.size_of(start)
        header, most = self._archive[member], MOST_PLANES * math.prod(shape)
        if header.dtype != np.uint8 or len(header.shape) != 2 or header.size_bytes > most:
            raise ValueError(f"block {index} of {name!r} of shape {header.shape}")
        coded = CodedFrames(self._member(member), entry.differences[index])
        return decode(coded, entry.step, shape)

    def _member(self, member: str) -> NDArray[Any]:
        array = self._archive.array(member)
        if arrays_sha256({member: array}) != self.facts["members"][member]:
            raise ValueError(f"{member!r} changed after it was written")
        return array

    def _check_sizes(self) -> None:
        """Refuse what no file of this size holds, before anything is made of it."""
        most = _MOST_INFLATION * self._path.stat().st_size
        sizes = {name: 4 * math.prod(entry.shape) for name, entry in self.bounded.items()}
        for name in self.exact:
            self._archive.check(name, most)
            header = self._archive[name]
            if header.dtype.kind not in "biuf":
                raise ValueError(f"{name!r} of {header.dtype}")
            sizes[name] = header.size_bytes
        plain = all(is_plain_name(name) and "/" not in name for name in sizes)
        if not plain or set(self.bounded) & set(self.exact):
            raise ValueError("arrays without plain names of their own")
        if sum(sizes.values()) > most:
            raise ValueError(f"arrays of {sum(sizes.values())} bytes, not at most {most}")


@contextmanager
def open_packed(path: Path | str) -> Iterator[PackedFile]:
    """Open a file that `write_packed` wrote.

    Raises
    ------
    DsnetError
        If it is none, or damaged.

    Examples
    --------
    >>> with open_packed("align.npz") as packed:  # doctest: +SKIP
    ...     offsets_m = packed.array("offsets")
    """
    path = Path(path)
    with ExitStack() as opened:
        with _damage_named(path):
            packed = PackedFile(path, opened.enter_context(open_npz(path)))
        yield packed


def _damage_named(path: Path) -> AbstractContextManager[None]:
    return damage_refused(
        lambda error: DsnetError(
            f"{path}, which does not unpack ({type(error).__name__}: {str(error)[:200]})",
            "a file written by `dsnet pack`",
            "Copy or pack it again.",
        ),
        RecursionError,
    )
