"""Predicted offsets against true ones in the rest pose, sequence by sequence.

For synthetic data the true offsets are the simulation's, so that what alignment put into pose and
shape counts as lost; of licensed files only the aligned offsets are known, each road's own. Where
a truth has a `static` misfit beside the moving tissue, the two are judged together and apart, and
movement is judged on what moves. Of a predictor that tells no static part, all is taken to move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.measure.predictions import SEQUENCE_MEAN, Candidate, Predictions
from bridge.measure.references import MotionArrays, true_offsets_m
from bridge.measure.rest_pose_errors import OffsetPiece, RestPoseErrors, TrueMovement
from bridge.measure.stillness import StillSpan, joint_speed_m_s, still_spans
from bridge.measure.trajectories import vertex_pieces


@dataclass(frozen=True)
class Compared:
    """One sequence as it was compared."""

    errors: dict[str, RestPoseErrors]
    """By candidate."""
    true_size_m: NDArray[np.float32]
    """(T,) mean length of the true moving offsets of each frame, metres."""
    spans: list[StillSpan]
    """When the body stands still."""


@dataclass(frozen=True)
class _TrueOffsets:
    read: Callable[[slice], OffsetPiece]
    spans: list[StillSpan]
    frames: slice
    fps: float


class RestPose:
    """Comparisons at rest of one run.

    Parameters
    ----------
    predictions : by road.
    motions : what each road was given; says when a body stands still if there is no truth.
    truth : arrays of the simulation, None for licensed data.
    """

    def __init__(
        self,
        body: BodyModelData,
        predictions: Mapping[str, Predictions],
        motions: Mapping[str, MotionArrays],
        truth: MotionArrays | None,
    ) -> None:
        self._body, self._truth = body, truth
        self._predictions, self._motions = predictions, motions

    def compare(self, name: str, chosen: Sequence[Candidate]) -> Compared | None:
        """Errors of one sequence; None if neither a simulation nor alignment knows it."""
        if self._truth is not None and name in self._truth.places:
            return self._compare(name, self._simulated(name, self._truth, chosen), chosen)
        found: Compared | None = None
        for road in dict.fromkeys(one.road.name for one in chosen):
            own = [one for one in chosen if one.road.name == road]
            if name in own[0].road.aligned:
                errors = self._compare(name, self._aligned(name, own), own)
                # The first road's alignment stands for the truth in figures.
                earlier = found or errors
                found = replace(earlier, errors=earlier.errors | errors.errors)
        return found

    def _compare(self, name: str, true: _TrueOffsets, chosen: Iterable[Candidate]) -> Compared:
        frames, vertices = true.frames.stop, len(self._body.v_template)
        movement = TrueMovement(true.spans, frames, true.fps)
        watched = [(one, RestPoseErrors(movement, frames, moves=one.moves)) for one in chosen]
        for piece in vertex_pieces(vertices):
            real = true.read(piece)
            movement.add(real)
            for one, errors in watched:
                errors.add(self._predicted(one, name, true, piece, real), real)
        for _, errors in watched:
            errors.finish()
        found = {one.name: errors for one, errors in watched}
        return Compared(found, movement.sizes.frames_m(), true.spans)

    def _predicted(
        self, one: Candidate, name: str, true: _TrueOffsets, piece: slice, real: OffsetPiece
    ) -> OffsetPiece:
        shape = real.total_m.shape
        if one.kind == SEQUENCE_MEAN:
            constant_m = _single(real.total_m.mean(axis=0, dtype=np.float64))
            return OffsetPiece.of(np.broadcast_to(constant_m, shape), None, true.fps)
        predictions = self._predictions[one.road.name]
        offsets_m = _single(predictions.offsets_m(one.kind, name, true.frames, piece))
        static_m = predictions.static_m(one.kind, name, true.frames, piece)
        return OffsetPiece.of(
            np.broadcast_to(offsets_m, shape),
            None if static_m is None else _single(static_m),
            true.fps,
        )

    def _simulated(
        self, name: str, truth: MotionArrays, chosen: Iterable[Candidate]
    ) -> _TrueOffsets:
        place = truth.places[name]
        frames = self._shared(name, chosen, place.length)

        def read(piece: slice) -> OffsetPiece:
            total_m = _single(true_offsets_m(truth, name, frames, piece))
            if not truth.has("static"):
                return OffsetPiece.of(total_m, None, place.fps)
            static_m = _single(truth.frames("static", name, frames, piece))
            return OffsetPiece.of(total_m, static_m, place.fps)

        return _TrueOffsets(read, self._spans(truth, name, frames), frames, place.fps)

    def _aligned(self, name: str, chosen: Sequence[Candidate]) -> _TrueOffsets:
        road = chosen[0].road
        place, predictions = road.aligned[name], self._predictions[road.name]
        frames = self._shared(name, chosen, place.length)

        def read(piece: slice) -> OffsetPiece:
            aligned_m = _single(predictions.aligned_m(name, frames, piece))
            return OffsetPiece.of(aligned_m, None, place.fps)

        spans = self._spans(self._motions[road.name], name, frames)
        return _TrueOffsets(read, spans, frames, place.fps)

    def _shared(self, name: str, chosen: Iterable[Candidate], length: int) -> slice:
        lengths = (self._predictions[one.road.name].length(name) for one in chosen)
        return slice(0, min(length, *lengths))

    def _spans(self, motions: MotionArrays, name: str, frames: slice) -> list[StillSpan]:
        fps, theta = motions.places[name].fps, motions.frames("theta", name, frames)
        return still_spans(joint_speed_m_s(self._body, motions.betas(name), theta, fps), fps)


def _single(offsets_m: NDArray) -> NDArray[np.float32]:
    return np.ascontiguousarray(offsets_m, dtype=np.float32)
