"""A packed file: an artifact's arrays in one `.npz`, those of vertices within a stated error.

`about` is JSON: what was packed, of which data, with which bound and unit, and the digest of every
other member. `NAME/00000`, ... are blocks of frames as `codec` codes them, deflated; any
other array stands under its own name as it was. NumPy's own `load` opens it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

FORMAT = "dsnet packed arrays, version 1"
ABOUT = "about"
FRAMES_PER_BLOCK = 128
BLOCK_BYTES = 64 << 20
"""Of a block's frames in float32, at most."""
MOST_BLOCKS = 8000
"""Of a file: as many members as its readers let the directory of an archive name."""


@dataclass(frozen=True)
class Bounded:
    """What a file declares of an array of vertices."""

    shape: tuple[int, int, int]
    """(T, V, 3)."""
    unit: str
    bound: float
    """Largest difference of any coordinate, in that unit."""
    step: float
    largest_error: float
    """Largest that there is, found when it was packed."""
    differences: tuple[int, ...]
    """Of each block."""

    @classmethod
    def of(cls, declared: Mapping[str, Any]) -> Bounded:
        """From JSON; ValueError, TypeError or KeyError where it is no such thing."""
        t, v, sides = (_whole(size) for size in declared["shape"])
        bound, step, error = (float(declared[key]) for key in ("bound", "step", "largest_error"))
        differences = tuple(_whole(times) for times in declared["differences"])
        entry = cls((t, v, sides), str(declared["unit"]), bound, step, error, differences)
        if not all(math.isfinite(x) and x >= 0 for x in (bound, step, error)) or not step > 0:
            raise ValueError(f"a bound of {bound} in steps of {step}")
        if sides != 3 or not 0 < v * sides * 4 <= BLOCK_BYTES:
            raise ValueError(f"vertices of shape {entry.shape}")
        if len(differences) != len(entry.blocks()) or len(differences) > MOST_BLOCKS:
            raise ValueError(f"{len(differences)} blocks for shape {entry.shape}")
        return entry

    @property
    def frames_per_block(self) -> int:
        """As many as fit into a block's bytes, at most 128."""
        return min(FRAMES_PER_BLOCK, BLOCK_BYTES // (4 * math.prod(self.shape[1:])))

    def blocks(self) -> range:
        """The first frame of each."""
        return range(0, self.shape[0], self.frames_per_block)

    def size_of(self, start: int) -> tuple[int, int, int]:
        """Shape of the block that begins at a frame."""
        t, v, sides = self.shape
        return (min(self.frames_per_block, t - start), v, sides)


def block_name(name: str, index: int) -> str:
    """The member that is a block of an array."""
    return f"{name}/{index:05}"


def _whole(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{value!r}, which is no size")
    return value
