"""`dsnet evaluate`: errors of every road's predictions, beside what learns nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.errors import notify
from bridge.measure.alignment_quality import alignment_errors
from bridge.measure.evaluation import Evaluation, SequenceErrors
from bridge.measure.pooled import Pool, PooledCells
from bridge.measure.rest_pose_errors import MovementErrors
from bridge.measure.roads import Road, roads_of, stages_of_roads
from bridge.measure.spectrum import STEP_HZ
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import INFER_PLUS, body_model_path
from bridge.runs.workers import progress, worker_pool

MESH_ERROR, OFFSET_SIZE = "mesh_error", "offset_size"
TRUE = "true"
"""In place of a predictor's name: the true offsets."""
_EVERYTHING = "everything"
_TEST_BED = {"tissue": "own", "form": "clean", "gravity": True, "gender": None}


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure every prediction of both roads: about 5 ms a frame, 1 GB.

    Gives errors of the posed meshes against the registered ones, which a licensed user has too, and
    for synthetic data against the true meshes of unseen motions; R2, velocity, spectrum, decay and
    rest of the offsets; all of them by cell, and mesh error and size of the offsets in each frame.
    """

    run: str = "demo"
    """Run to evaluate."""


PROFILES = {name: EvaluateConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: EvaluateConfig) -> None:
    """Run the stage, saying what the run lacks; a result that is current is kept.

    Raises
    ------
    DsnetError
        If the run came to the end of no road, or one is older than what it was made from.
    """
    run = Run(config.run)
    upstream = run.artifacts(*stages_of_roads(run))
    roads = roads_of(upstream)
    origin = roads[0].align.origin
    # The truth belongs to the run's own corpus, not to licensed meshes aligned beside it.
    whole = {"decode", INFER_PLUS} | ({"truth"} if origin == "synthetic" else set())
    if "truth" in whole and run.finished("truth"):
        upstream["truth"] = run.artifact("truth")
    if absent := sorted(whole - set(upstream)):
        notify(f"run {run.name!r} is evaluated without {', '.join(absent)}, which it does not have")
    body = load_body_model(str(body_model_path(run)))
    run.build(
        "evaluate",
        config,
        lambda writer: evaluate_roads(writer, roads, upstream.get("truth"), body),
        data=origin,
        upstream=upstream,
    )


def evaluate_roads(
    writer: ArtifactWriter, roads: Sequence[Road], truth: Artifact | None, body: BodyModelData
) -> None:
    """Fill an artifact with the errors of every predictor of some roads, the first road's first."""
    evaluation = Evaluation(roads, truth, body)
    found = _KeptErrors()
    for one in _compared(evaluation):
        found.add(one, evaluation)
    found.mesh_errors_m.write(writer, MESH_ERROR, "m, mean over vertices")
    found.sizes_m.write(writer, OFFSET_SIZE, "m, mean over vertices")
    for name, movement in found.movements().items():
        writer.put(f"spectrum_{name}", movement.spectrum.rms_mm(), "mm; true, predicted, error")
    alignments = {road.alignment: alignment_errors(road.align, truth, body) for road in roads}
    writer.record(
        sequences=to_manifest(found.sequences),
        predictors={name: one.label for name, one in evaluation.candidates.items()},
        default=roads[-1].default,
        roads={road.name: _described_road(road) for road in roads},
        test_bed=None if truth is None else _test_bed(truth, body),
        per_sequence=found.described,
        cells=found.cells.summary(),
        spectrum_step_hz=STEP_HZ,
        alignment=alignments[roads[0].alignment],
        alignments=alignments,
    )


class _KeptErrors:
    """What is kept of all sequences' errors, so that thousands of sequences fit in memory."""

    def __init__(self) -> None:
        self.sequences: list[MotionSequence] = []
        self.described: list[dict[str, Any]] = []
        self.cells, self._everything = PooledCells(), PooledCells()
        self.mesh_errors_m, self.sizes_m = _FrameRows(), _FrameRows()

    def add(self, one: SequenceErrors, evaluation: Evaluation) -> None:
        """Take in one sequence."""
        self.sequences.append(one.sequence)
        self.described.append(_described(one, evaluation))
        self.cells.add(evaluation.cells(one.sequence), one.errors)
        self._everything.add([_EVERYTHING], one.errors)
        self.mesh_errors_m.add(one.sequence, _mesh_errors_m(one))
        self.sizes_m.add(one.sequence, _sizes_m(one))

    def movements(self) -> dict[str, MovementErrors]:
        """Over all test sequences; over all there are in a run without one."""
        tested = any(sequence.split == "test" for sequence in self.sequences)
        return self.cells.movements("test") if tested else self._everything.movements(_EVERYTHING)


def _compared(evaluation: Evaluation) -> Iterator[SequenceErrors]:
    sequences = evaluation.sequences()
    with worker_pool("threads", evaluation) as pool:
        yield from progress(
            pool.map(Evaluation.compare, sequences),
            what="evaluate",
            unit="sequence",
            total=len(sequences),
        )


def _described_road(road: Road) -> dict[str, Any]:
    return {
        "predictors": list(road.predictors),
        "default": road.default,
        "alignment": road.alignment,
        "aligner": road.align.manifest["config"].get("aligner"),
    }


def _test_bed(truth: Artifact, body: BodyModelData) -> dict[str, Any]:
    """Law and form of the tissue, whether gravity loads it, and whose bodies."""
    known = {key: truth.manifest.get(key, usual) for key, usual in _TEST_BED.items()}
    return known | {"gender": known["gender"] or body.gender}


def _described(found: SequenceErrors, evaluation: Evaluation) -> dict[str, Any]:
    sequence, errors = found.sequence, found.errors
    meshes = {name: one.mesh for name, one in errors.items() if one.mesh is not None}
    return {
        "name": sequence.name,
        "subject": sequence.subject,
        "motion": sequence.motion,
        "split": sequence.split,
        "cell": evaluation.cells(sequence)[-1],
        "person": "known" if evaluation.knows(sequence) else "new",
        "frames": sequence.length,
        "stands_still_s": _still_s(found),
        "errors": {name: Pool([one]).summary() for name, one in errors.items()},
        "mesh_frame_error_mm": {name: one.frame_summary_mm() for name, one in meshes.items()},
    }


def _still_s(found: SequenceErrors) -> list[list[float]]:
    """First and last second of each stretch in which the body stands still."""
    spans = [] if found.at_rest is None else found.at_rest.spans
    return [[edge / found.sequence.fps for edge in (span.start, span.stop)] for span in spans]


def frame_errors_m(evaluate: Artifact, predictor: str, sequence: str) -> NDArray[np.float32] | None:
    """(T,) error of the posed mesh in each frame, mean over its vertices; None if not measured."""
    return _frames(evaluate, MESH_ERROR, predictor, sequence)


def offset_sizes_m(evaluate: Artifact, predictor: str, sequence: str) -> NDArray[np.float32] | None:
    """(T,) mean length of the moving offsets in each frame; None if not measured.

    Of a predictor, or with `TRUE` in place of its name of the true offsets.
    """
    return _frames(evaluate, OFFSET_SIZE, predictor, sequence)


def _frames(
    evaluate: Artifact, kind: str, predictor: str, sequence: str
) -> NDArray[np.float32] | None:
    entries = evaluate.manifest[f"{kind}_sequences"].get(predictor, [])
    place = next((MotionSequence(**one) for one in entries if one["name"] == sequence), None)
    return None if place is None else evaluate.array(f"{kind}_{predictor}")[place.frames]


FrameValues = Mapping[str, NDArray[np.float32]]
"""(T,) of one sequence, by predictor."""


def _mesh_errors_m(one: SequenceErrors) -> FrameValues:
    meshes = {name: own.mesh for name, own in one.errors.items() if own.mesh is not None}
    return {name: mesh.frames_m() for name, mesh in meshes.items()}


def _sizes_m(one: SequenceErrors) -> FrameValues:
    sizes = {
        name: own.at_rest.sizes.frames_m()
        for name, own in one.errors.items()
        if own.at_rest is not None and own.movement() is not None
    }
    true = {} if one.at_rest is None else {TRUE: one.at_rest.true_size_m}
    return true | sizes


class _FrameRows:
    """Arrays without gaps: a predictor has frames only where it was compared."""

    def __init__(self) -> None:
        self._index: dict[str, list[MotionSequence]] = {}
        self._values: dict[str, list[NDArray[np.float32]]] = {}

    def add(self, sequence: MotionSequence, by_name: FrameValues) -> None:
        """Take in one sequence."""
        for name, frames_m in by_name.items():
            places = self._index.setdefault(name, [])
            start = places[-1].frames.stop if places else 0
            places.append(replace(sequence, start=start, length=len(frames_m)))
            self._values.setdefault(name, []).append(frames_m)

    def write(self, writer: ArtifactWriter, kind: str, unit: str) -> None:
        """An array for each predictor, and where each sequence lies in it."""
        for name, parts in self._values.items():
            writer.put(f"{kind}_{name}", np.concatenate(parts), unit)
        index = {name: to_manifest(places) for name, places in self._index.items()}
        writer.record(**{f"{kind}_sequences": index})
