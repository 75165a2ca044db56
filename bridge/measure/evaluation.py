"""Errors of every predictor of every road on one sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.measure.metrics import FrameErrors
from bridge.measure.pooled import PredictorErrors
from bridge.measure.predictions import SEQUENCE_MEAN, SMPL, Candidate, Predictions, candidates
from bridge.measure.references import Block, MotionArrays, References
from bridge.measure.rest_pose import Compared, RestPose
from bridge.measure.roads import Road
from bridge.motion import MotionSequence
from bridge.motion.splits import cell_of, trained_people_and_kinds
from bridge.runs import Artifact


@dataclass(frozen=True)
class SequenceErrors:
    """What was found on one sequence."""

    sequence: MotionSequence
    errors: dict[str, PredictorErrors]
    """By candidate, those that could be compared."""
    at_rest: Compared | None
    """What was compared in the rest pose; None if no true offsets are known."""


class Evaluation:
    """All comparisons of one run; its sequences are independent of one another.

    Parameters
    ----------
    roads : the run's roads, one at least.
    truth : artifact of the simulation, None for licensed data.
    """

    def __init__(self, roads: Sequence[Road], truth: Artifact | None, body: BodyModelData) -> None:
        simulated = None if truth is None else MotionArrays.of(truth)
        self.candidates = candidates(roads)
        self._places = [road.sequences for road in reversed(roads)]
        self._predictions = {road.name: Predictions(road) for road in roads}
        given = {road.name: MotionArrays.of(road.motions) for road in roads}
        self._references = References(body, roads, simulated)
        self._at_rest = RestPose(body, self._predictions, given, simulated)
        trained = [s for road in roads for s in road.aligned.values()]
        self._people, self._kinds = trained_people_and_kinds(trained)

    def sequences(self) -> list[MotionSequence]:
        """Every sequence that some road has predicted, the first road's in their order first."""
        found: dict[str, MotionSequence] = {}
        for places in reversed(self._places):
            found = found | {name: place for name, place in places.items() if name not in found}
        return list(found.values())

    def knows(self, sequence: MotionSequence) -> bool:
        """Whether the person was trained on."""
        return sequence.subject in self._people

    def cells(self, sequence: MotionSequence) -> list[str]:
        """Groups of sequences whose errors are pooled: test sequences have a cell of their own."""
        if sequence.split != "test":
            return [sequence.split]
        return ["test", cell_of(sequence, self._people, self._kinds)]

    def compare(self, sequence: MotionSequence) -> SequenceErrors:
        """Errors of one sequence."""
        name = sequence.name
        chosen = [
            one
            for one in self.candidates.values()
            if self._predictions[one.road.name].has(one.kind, name)
        ]
        # No offset is the same on every road, while SMPL's mesh is not.
        rested = [one for one in chosen if one.kind != SMPL or one.name == SMPL]
        at_rest = self._at_rest.compare(name, rested)
        mesh = self._of_meshes(name, chosen) if self._references.has(name) else {}
        found = {} if at_rest is None else at_rest.errors
        errors = {
            one.name: PredictorErrors(mesh.get(one.name), found.get(one.name))
            for one in chosen
            if one.name in mesh or one.name in found
        }
        return SequenceErrors(sequence, errors, at_rest)

    def _of_meshes(self, name: str, chosen: Sequence[Candidate]) -> dict[str, FrameErrors]:
        compared = [one for one in chosen if one.kind != SEQUENCE_MEAN]
        found = {one.name: FrameErrors() for one in compared}
        roads = list(dict.fromkeys(one.road.name for one in compared))
        for blocks in self._references.blocks(name, roads):
            for one in compared:
                block = blocks[one.road.name]
                found[one.name].add(self._carried_m(one, name, block), block.lacking_m)
        return found

    def _carried_m(self, one: Candidate, name: str, block: Block) -> NDArray:
        if one.kind == SMPL:
            return np.zeros_like(block.lacking_m)
        offsets_m = self._predictions[one.road.name].offsets_m(one.kind, name, block.frames)
        return block.posed.carried(offsets_m)
