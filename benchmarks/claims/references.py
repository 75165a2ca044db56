"""Offsets of a sequence that predicted codes are held against."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.paper import N_VERTICES
from dsnet.evaluation.pipelines import MotionArrays

Decode = Callable[[NDArray], NDArray]
"""From codes (B, 100) to offsets (B, V, 3), metres."""
_PIECE = 64
"""Frames that are decoded at once."""


class Reference(Protocol):
    """Offsets of a sequence that predicted codes are held against."""

    @property
    def squares(self) -> NDArray[np.float64]:
        """(T,) squared size of the offsets, square metres."""
        ...

    def errors(self, codes: NDArray, start: int = 0) -> NDArray[np.float64]:
        """(T - start,) squared error of codes of the frames from `start` on, as of the offsets that
        they stand for."""
        ...

    def moved(self, codes: NDArray, others: NDArray) -> tuple[float, float]:
        """Squared distance of what two predictions stand for, and squared size of the first."""
        ...


@dataclass(frozen=True, eq=False)
class InComponents:
    """A reference as coefficients, and squares that they leave out."""

    codes: NDArray[np.float64]
    """(T, 100), metres."""
    left_out: NDArray[np.float64]
    """(T,) squared distance from the components' span."""
    squares: NDArray[np.float64]
    """(T,) squared size of the offsets."""

    def errors(self, codes: NDArray, start: int = 0) -> NDArray[np.float64]:
        """As of orthonormal directions."""
        return np.square(codes - self.codes[start:]).sum(axis=1) + self.left_out[start:]

    def moved(self, codes: NDArray, others: NDArray) -> tuple[float, float]:
        """About the components' mean."""
        return float(np.square(codes - others).sum()), float(np.square(codes).sum())


@dataclass(frozen=True, eq=False)
class InOffsets:
    """A reference as an artifact's offsets, to which codes are decoded."""

    arrays: MotionArrays
    name: str
    decode: Decode

    @cached_property
    def squares(self) -> NDArray[np.float64]:
        """(T,) squared size of the offsets, square metres."""
        return self.errors(np.empty((self.arrays.sequences[self.name].length, 0)))

    def errors(self, codes: NDArray, start: int = 0) -> NDArray[np.float64]:
        """A piece at a time; codes without numbers stand for no offset."""
        found = []
        for at in range(0, len(codes), _PIECE):
            piece = codes[at : at + _PIECE]
            rows = slice(start + at, start + at + len(piece))
            wanted_m = self.arrays.frames("offsets", self.name, rows)
            found.append(_squares(wanted_m - self.decode(piece) if piece.size else wanted_m))
        return np.concatenate(found)

    def moved(self, codes: NDArray, others: NDArray) -> tuple[float, float]:
        """Of the decoded offsets."""
        apart = size = 0.0
        for at in range(0, len(codes), _PIECE):
            one, other = (self.decode(c[at : at + _PIECE]) for c in (codes, others))
            apart += float(_squares(one - other).sum())
            size += float(_squares(one).sum())
        return apart, size


def _squares(offsets_m: NDArray) -> NDArray[np.float64]:
    """(B,) squared size of offsets (B, V, 3)."""
    flat = offsets_m.reshape(len(offsets_m), -1)
    return np.einsum("ij,ij->i", flat, flat, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class ScoredMotion:
    """A sequence to predict: motion, shape and the offsets that are right."""

    name: str
    cell: str
    theta: NDArray
    betas: NDArray
    reference: Reference


def root_mean_square_mm(tested: Sequence[ScoredMotion], cell: str) -> float:
    """Of a test group's true offsets: what tells the data of one run from another's."""
    squares = np.concatenate([one.reference.squares for one in tested if one.cell == cell])
    return round(1e3 * float(np.sqrt(squares.mean() / N_VERTICES)), 4)


def r2(errors: NDArray, squares: NDArray) -> float:
    """1 for no error, 0 for no offset."""
    return float(1.0 - errors.sum() / squares.sum())
