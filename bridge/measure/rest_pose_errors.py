"""Errors of one predictor's offsets in the rest pose: their size, their parts, how they move."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.measure import decay
from bridge.measure.metrics import ErrorSums
from bridge.measure.rest import RestSums
from bridge.measure.spectrum import SpectrumSums
from bridge.measure.stillness import StillSpan
from bridge.measure.trajectories import Trajectories
from bridge.measure.velocity import VelocityErrors


@dataclass(frozen=True)
class OffsetPiece:
    """Offsets of some vertices in all frames of a sequence, predicted or true."""

    total_m: NDArray[np.float32]
    """(T, P, 3) what a mesh has over SMPL, metres."""
    static_m: NDArray[np.float32] | None
    """(T, P, 3) the part of it that does not swing; None where nothing is known apart."""
    path: Trajectories
    """What swings: all of it, or all but the static part."""

    @classmethod
    def of(cls, total_m: NDArray, static_m: NDArray | None, fps: float) -> OffsetPiece:
        """Take the static part from the total."""
        moving_m = total_m if static_m is None else total_m - static_m
        return cls(total_m, static_m, Trajectories(moving_m, fps))


@dataclass
class MovementErrors:
    """How the offsets of one predictor move, in one sequence or in many."""

    velocity: VelocityErrors = field(default_factory=VelocityErrors)
    spectrum: SpectrumSums = field(default_factory=SpectrumSums)
    rest: RestSums = field(default_factory=RestSums)
    decays: list[decay.Decay] = field(default_factory=list)

    def merge(self, other: MovementErrors) -> None:
        """Take in all that `other` has."""
        self.velocity.merge(other.velocity)
        self.spectrum.merge(other.spectrum)
        self.rest.merge(other.rest)
        self.decays += other.decays

    def summary(self) -> dict[str, Any]:
        """`velocity`, `spectrum`, `decay` and `rest`; the last two None where nothing is still."""
        return {
            "velocity": self.velocity.summary(),
            "spectrum": self.spectrum.summary(),
            "decay": decay.summary(self.decays),
            "rest": self.rest.summary(),
        }


class TrueMovement:
    """What the true offsets of one sequence give, for all predictors once.

    Parameters
    ----------
    spans : when the body stands still.
    frames : how many there are.
    """

    def __init__(self, spans: list[StillSpan], frames: int, fps: float) -> None:
        self.spans, self.fps = spans, fps
        self.swings, self.sizes = decay.SwingSums(spans), SizeSums(frames)

    def add(self, true: OffsetPiece) -> None:
        """Take in some vertices."""
        self.swings.add(true.path)
        self.sizes.add(true.path)


class SizeSums:
    """Mean length of the offsets of each frame, summed up over pieces of the mesh."""

    def __init__(self, frames: int) -> None:
        self._sums_m, self._vertices = np.zeros(frames), 0

    def add(self, path: Trajectories) -> None:
        """Take in some vertices."""
        self._sums_m += np.linalg.norm(path.offsets_m, axis=-1).sum(axis=1, dtype=np.float64)
        self._vertices += path.offsets_m.shape[1]

    def frames_m(self) -> NDArray[np.float32]:
        """(T,) mean over vertices, metres."""
        return (self._sums_m / max(self._vertices, 1)).astype(np.float32)


class RestPoseErrors:
    """Errors of one predictor on one sequence.

    Parameters
    ----------
    true : what the sequence's true offsets give.
    moves : whether the predictor's offsets change over time; else it has no movement to judge.
    """

    def __init__(self, true: TrueMovement, frames: int, *, moves: bool) -> None:
        self.offsets = ErrorSums()
        self.parts: dict[str, ErrorSums] = {}
        self.movement = MovementErrors() if moves else None
        self.sizes = SizeSums(frames)
        self._true, self._swings = true, decay.SwingSums(true.spans)

    def add(self, predicted: OffsetPiece, true: OffsetPiece) -> None:
        """Take in some vertices."""
        self.offsets.add(predicted.total_m, true.total_m)
        if true.static_m is not None:
            self._add_part("moving", predicted.path.offsets_m, true.path.offsets_m)
            if predicted.static_m is not None:
                self._add_part("static", predicted.static_m, true.static_m)
        if self.movement is not None:
            self.movement.velocity.add(predicted.path, true.path)
            self.movement.spectrum.add(predicted.path, true.path)
            self.movement.rest.add(predicted.path, true.path, self._true.spans)
            self._swings.add(predicted.path)
            self.sizes.add(predicted.path)

    def finish(self) -> None:
        """Compare what needs all vertices; call it once, after the last piece."""
        if self.movement is not None:
            true = self._true
            self.movement.decays = decay.decays(self._swings, true.swings, true.fps)

    def _add_part(self, part: str, predicted_m: NDArray, true_m: NDArray) -> None:
        self.parts.setdefault(part, ErrorSums()).add(predicted_m, true_m)
