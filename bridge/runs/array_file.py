"""Arrays of an artifact that several processes, on several machines, fill together."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_flush_data = getattr(os, "fdatasync", os.fsync)
"""Windows and macOS have only the one that flushes the file's times, too."""


@dataclass(frozen=True)
class ArrayFile:
    """An `.npy` file that is filled in pieces; made by `ArtifactWriter.array_file`.

    It can be sent to other processes. Pieces are written at their place in the file, not through
    memory maps: of a page that two machines have mapped the later one to write it back wins whole.
    """

    path: Path
    """Absolute; on a cluster every machine has to see it there."""
    shape: tuple[int, ...]
    dtype: str
    header_bytes: int
    """Where the first element lies."""

    def read(self, rows: slice) -> NDArray[Any]:
        """Rows as they are now."""
        return np.array(np.memmap(self.path, self.dtype, "r", self.header_bytes, self.shape)[rows])

    def write(self, start: int, rows: ArrayLike) -> None:
        """Store rows (n, ...) from row `start` on; they are on the disk when this returns.

        Raises
        ------
        ValueError
            If they do not fit.
        """
        values = np.ascontiguousarray(rows, self.dtype)
        fits = values.shape[1:] == self.shape[1:] and 0 <= start <= self.shape[0] - len(values)
        if not fits:
            raise ValueError(
                f"rows {start} of shape {values.shape} for {self.path.name} of {self.shape}"
            )
        row_bytes = values.dtype.itemsize * int(np.prod(self.shape[1:], dtype=np.int64))
        left, place = values.reshape(-1).view(np.uint8).data, self.header_bytes + start * row_bytes
        with open(self.path, "r+b", buffering=0) as file:
            file.seek(place)
            while left:
                left = left[file.write(left) :]
            _flush_data(file.fileno())
