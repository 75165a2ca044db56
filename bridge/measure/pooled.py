"""Errors of a predictor on one sequence, and on all sequences of a cell together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from bridge.measure.metrics import ErrorSums, FrameErrors, SquaredSums, jackknife_r2_se
from bridge.measure.rest_pose_errors import MovementErrors, RestPoseErrors


@dataclass
class PredictorErrors:
    """One predictor on one sequence."""

    mesh: FrameErrors | None = None
    """Of posed meshes."""
    at_rest: RestPoseErrors | None = None
    """Of offsets in the rest pose."""

    def sums(self) -> dict[str, ErrorSums]:
        """Errors in millimetres by what is compared: `mesh`, `offsets`, `moving`, `static`."""
        found = {} if self.mesh is None else {"mesh": self.mesh.sums}
        if self.at_rest is not None:
            found |= {"offsets": self.at_rest.offsets} | self.at_rest.parts
        return found

    def movement(self) -> MovementErrors | None:
        """How its offsets move."""
        return None if self.at_rest is None else self.at_rest.movement


Errors = Mapping[str, PredictorErrors]
"""Of one sequence, by predictor."""


@dataclass
class _Squares:
    """What the spread over sequences needs of one of them."""

    squared_error: float
    squared_reference: float

    @classmethod
    def of(cls, sums: SquaredSums) -> _Squares:
        return cls(sums.squared_error, sums.squared_reference)


class Pool:
    """All figures of one predictor over some sequences, of which only sums are kept.

    A sequence's own errors hold histograms of a megabyte or more, and there may be thousands.
    """

    def __init__(self, parts: Iterable[PredictorErrors] = ()) -> None:
        self._sums: dict[str, ErrorSums] = {}
        self._squares: dict[str, list[_Squares]] = {}
        self.movement: MovementErrors | None = None
        """How the offsets of all of them move; None where they do not."""
        self._velocities: list[_Squares] = []
        for part in parts:
            self.add(part)

    def add(self, part: PredictorErrors) -> None:
        """Take in one sequence."""
        for name, sums in part.sums().items():
            self._sums.setdefault(name, ErrorSums()).merge(sums)
            self._squares.setdefault(name, []).append(_Squares.of(sums))
        if (movement := part.movement()) is not None:
            self.movement = self.movement or MovementErrors()
            self.movement.merge(movement)
            self._velocities.append(_Squares.of(movement.velocity))

    def summary(self) -> dict[str, Any]:
        """`mesh`, `offsets` and, where the truth tells them apart, `moving` and `static`, each as
        `ErrorSums.summary` with `r2_se`, the spread over sequences; `velocity` (with its own),
        `spectrum`, `decay` and `rest` as `MovementErrors.summary`. What was not compared is
        missing.
        """
        found: dict[str, Any] = {
            name: sums.summary() | {"r2_se": jackknife_r2_se(self._squares[name])}
            for name, sums in self._sums.items()
        }
        if self.movement is not None:
            found |= self.movement.summary()
            found["velocity"]["r2_se"] = jackknife_r2_se(self._velocities)
        return found


class PooledCells:
    """Figures of all sequences of a cell together, by cell and predictor."""

    def __init__(self) -> None:
        self._pools: dict[str, dict[str, Pool]] = {}

    def add(self, cells: Iterable[str], errors: Errors) -> None:
        """Take in the errors of one sequence, which belongs to some cells."""
        for cell in cells:
            for name, one in errors.items():
                self._pools.setdefault(cell, {}).setdefault(name, Pool()).add(one)

    def summary(self) -> dict[str, Any]:
        """`Pool.summary` of each, by cell and predictor."""
        return {
            cell: {name: pool.summary() for name, pool in pools.items()}
            for cell, pools in self._pools.items()
        }

    def movements(self, cell: str) -> dict[str, MovementErrors]:
        """How offsets move over all of a cell's sequences, by predictor that moves."""
        pools = self._pools.get(cell, {})
        return {name: pool.movement for name, pool in pools.items() if pool.movement is not None}
