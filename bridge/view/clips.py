"""Skin offsets of motions, by what was asked for: what is kept while one looks at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body.parts import PARTS
from bridge.runtime.controls import Floor
from bridge.view.truth import TRUTH

SMPL_ALONE = "smpl"
LABELS = {SMPL_ALONE: "SMPL alone", TRUTH: TRUTH}


@dataclass(frozen=True)
class Way:
    """How somebody moves, apart from the skin."""

    take: str
    """Which motion."""
    betas: tuple[float, ...]
    """Ten shape coefficients."""
    floor: Floor = "keep"
    loop: bool = False


@dataclass(frozen=True)
class Asked:
    """Whose offsets: the key that they are kept by."""

    way: Way
    predictor: str


@dataclass(frozen=True)
class Gains:
    """By what predicted offsets are multiplied."""

    of_all: float = 1.0
    of_parts: tuple[float, ...] = (1.0,) * len(PARTS)
    """Of `PARTS`, on top of it."""


AS_PREDICTED = Gains()


class Clip:
    """Offsets of T frames, filled from the first on while one looks at them."""

    def __init__(self, frames: int, vertices: int) -> None:
        self.offsets_m = np.zeros((frames, vertices, 3), np.float32)
        """(T, V, 3) in the rest pose, metres; 0 from frame `ready` on."""
        self.ready = 0

    @property
    def complete(self) -> bool:
        """Whether all frames are there."""
        return self.ready == len(self.offsets_m)

    def add(self, offsets_m: NDArray[np.float32]) -> None:
        """Put the next frames (T', V, 3) behind those that are there."""
        end = min(self.ready + len(offsets_m), len(self.offsets_m))
        self.offsets_m[self.ready : end] = offsets_m[: end - self.ready]
        self.ready = end
