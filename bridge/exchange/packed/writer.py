"""Writing packed files, block by block."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.packed.codec import decode, encode, step_for
from bridge.exchange.packed.layout import (
    ABOUT,
    BLOCK_BYTES,
    FORMAT,
    FRAMES_PER_BLOCK,
    MOST_BLOCKS,
    Bounded,
    block_name,
)
from bridge.runs.artifact import DataOrigin
from bridge.runs.digests import arrays_sha256, json_sha256


@dataclass(eq=False)
class PackedWriter:
    """Fills a packed file; made by `write_packed`."""

    _archive: zipfile.ZipFile
    _facts: dict[str, Any]
    _bounded: dict[str, Any] = field(default_factory=dict)
    _exact: dict[str, Any] = field(default_factory=dict)
    _members: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, array: NDArray[Any], unit: str) -> None:
        """Store an array as it is."""
        self._exact[name] = {"shape": list(array.shape), "dtype": array.dtype.str, "unit": unit}
        self._put(name, array)

    def add_bounded(self, name: str, array: NDArray[Any], unit: str, bound: float) -> float:
        """Store vertices (T, V, 3), each coordinate within `bound`; gives the largest error.

        Raises
        ------
        DsnetError
            If a number is not finite, or the bound or the array too small or large.
        """
        step = step_for(bound, _largest(name, array), unit)
        t, v, sides = array.shape
        entry = Bounded((t, v, sides), unit, bound, step, 0.0, ())
        if 4 * v * sides > BLOCK_BYTES or len(entry.blocks()) > MOST_BLOCKS:
            raise DsnetError(
                f"{name!r} of shape {array.shape}",
                f"at most {MOST_BLOCKS * entry.frames_per_block} frames in a file",
                "Pack it in parts.",
            )
        errors, differences = [0.0], []
        for start in entry.blocks():
            frames = np.asarray(array[start : start + entry.frames_per_block])
            coded = encode(frames, step)
            again = decode(coded, step, entry.size_of(start)).astype(np.float64)
            errors.append(float(np.abs(again - frames).max(initial=0)))
            differences.append(coded.differences)
            self._put(block_name(name, start // entry.frames_per_block), coded.planes)
        kept = {"differences": differences, "largest_error": max(errors)}
        self._bounded[name] = {**asdict(entry), **kept}
        return max(errors)

    def finish(self) -> None:
        """Write what the file says of itself."""
        facts = {"format": FORMAT, **self._facts, "bounded": self._bounded, "exact": self._exact}
        # As it will be read: tuples are lists there.
        content = json.loads(json.dumps({**facts, "members": self._members}))
        about = {"content": content, "sha256": json_sha256(content)}
        self._write(ABOUT, np.array(json.dumps(about, sort_keys=True)))

    def _put(self, member: str, array: NDArray[Any]) -> None:
        self._members[member] = arrays_sha256({member: array})
        self._write(member, array)

    def _write(self, member: str, array: NDArray[Any]) -> None:
        # Under its name alone: zipfile then gives every member the same date.
        with self._archive.open(f"{member}.npy", "w", force_zip64=True) as stream:
            npy.write_array(stream, np.asarray(array), allow_pickle=False)


@contextmanager
def write_packed(path: Path, *, data: DataOrigin, **facts: Any) -> Iterator[PackedWriter]:
    """A writer of a new file; `facts` are JSON values that the file says of itself."""
    with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        writer = PackedWriter(archive, {"data": data, **facts})
        yield writer
        writer.finish()


def _largest(name: str, array: NDArray[Any]) -> float:
    """Largest size of any number; refused where one is not finite."""
    largest = 0.0
    for start in range(0, len(array), FRAMES_PER_BLOCK):
        found = float(np.abs(array[start : start + FRAMES_PER_BLOCK]).max(initial=0))
        if not math.isfinite(found):
            raise DsnetError(
                f"{name!r} with {found} among frames {start} to {start + FRAMES_PER_BLOCK - 1}",
                "finite numbers only",
                "Make the array again.",
            )
        largest = max(largest, found)
    return largest
