"""Errors of a predictor on one sequence, and on all sequences of a cell together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge.measure.metrics import ErrorSums, FrameErrors, jackknife_r2_se
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


def summarise(parts: Sequence[PredictorErrors]) -> dict[str, Any]:
    """All figures of one predictor over some sequences.

    Returns
    -------
    dict
        `mesh`, `offsets` and, in the captured form, `moving` and `static`, each as
        `ErrorSums.summary` with `r2_se`, the spread over sequences; `velocity` (with its own),
        `spectrum`, `decay` and `rest` as `MovementErrors.summary`. What
        was not compared is missing.
    """
    found: dict[str, Any] = {}
    by_name: dict[str, list[ErrorSums]] = {}
    for part in parts:
        for name, sums in part.sums().items():
            by_name.setdefault(name, []).append(sums)
    for name, sums in by_name.items():
        found[name] = ErrorSums.merged(sums).summary() | {"r2_se": jackknife_r2_se(sums)}
    movements = [movement for part in parts if (movement := part.movement()) is not None]
    if movements:
        found |= MovementErrors.merged(movements).summary()
        velocities = [movement.velocity for movement in movements]
        found["velocity"]["r2_se"] = jackknife_r2_se(velocities)
    return found


def pooled(found: Iterable[tuple[Iterable[str], Errors]]) -> dict[str, Any]:
    """Figures of all sequences of a cell together, by cell and predictor.

    Parameters
    ----------
    found : for each sequence the cells that it belongs to, and its errors.
    """
    parts: dict[str, dict[str, list[PredictorErrors]]] = {}
    for cells, errors in found:
        for cell in cells:
            for name, one in errors.items():
                parts.setdefault(cell, {}).setdefault(name, []).append(one)
    return {
        cell: {name: summarise(own) for name, own in by_name.items()}
        for cell, by_name in parts.items()
    }


def spectra(found: Iterable[Errors]) -> dict[str, MovementErrors]:
    """Movement over all of some sequences, by predictor that moves."""
    parts: dict[str, list[MovementErrors]] = {}
    for errors in found:
        for name, one in errors.items():
            if (movement := one.movement()) is not None:
                parts.setdefault(name, []).append(movement)
    return {name: MovementErrors.merged(own) for name, own in parts.items()}
