"""`dsnet evaluate`: errors of every road's predictions, beside what learns nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import BodyModelData, load_body_model
from bridge.measure.alignment_quality import alignment_errors
from bridge.measure.evaluation import Evaluation, SequenceErrors
from bridge.measure.pooled import pooled, spectra, summarise
from bridge.measure.roads import Road, roads_of, stages_of_roads
from bridge.measure.spectrum import STEP_HZ
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import body_model_path
from bridge.runs.worker_pool import worker_pool

MESH_ERROR, OFFSET_SIZE = "mesh_error", "offset_size"
TRUE = "true"
"""In place of a predictor's name: the true offsets."""
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
    """Run the stage; a result that is current is kept.

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
    if origin == "synthetic" and run.finished("truth"):
        upstream["truth"] = run.artifact("truth")
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
    found = _compared(evaluation)
    _write_frames(writer, MESH_ERROR, _mesh_errors_m(found), "m, mean over vertices")
    _write_frames(writer, OFFSET_SIZE, _sizes_m(found), "m, mean over vertices")
    tested = [one.errors for one in found if one.sequence.split == "test"]
    for name, movement in spectra(tested or [one.errors for one in found]).items():
        writer.put(f"spectrum_{name}", movement.spectrum.rms_mm(), "mm; true, predicted, error")
    alignments = {road.alignment: alignment_errors(road.align, truth, body) for road in roads}
    writer.record(
        sequences=to_manifest(one.sequence for one in found),
        predictors={name: one.label for name, one in evaluation.candidates.items()},
        default=roads[-1].default,
        roads={road.name: _described_road(road) for road in roads},
        test_bed=None if truth is None else _test_bed(truth, body),
        per_sequence=[_described(one, evaluation) for one in found],
        cells=pooled((evaluation.cells(one.sequence), one.errors) for one in found),
        spectrum_step_hz=STEP_HZ,
        alignment=alignments[roads[0].alignment],
        alignments=alignments,
    )


def _compared(evaluation: Evaluation) -> list[SequenceErrors]:
    sequences = evaluation.sequences()
    with worker_pool("threads", evaluation) as pool:
        compared = tqdm(
            pool.map(Evaluation.compare, sequences),
            desc="evaluate",
            total=len(sequences),
            unit="sequence",
            disable=None,
        )
        return list(compared)


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
        "errors": {name: summarise([one]) for name, one in errors.items()},
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


FrameValues = Iterable[tuple[MotionSequence, Mapping[str, NDArray[np.float32]]]]


def _mesh_errors_m(found: Iterable[SequenceErrors]) -> FrameValues:
    for one in found:
        meshes = {name: own.mesh for name, own in one.errors.items() if own.mesh is not None}
        yield one.sequence, {name: mesh.frames_m() for name, mesh in meshes.items()}


def _sizes_m(found: Iterable[SequenceErrors]) -> FrameValues:
    for one in found:
        sizes = {
            name: own.at_rest.sizes.frames_m()
            for name, own in one.errors.items()
            if own.at_rest is not None and own.movement() is not None
        }
        true = {} if one.at_rest is None else {TRUE: one.at_rest.true_size_m}
        yield one.sequence, true | sizes


def _write_frames(writer: ArtifactWriter, kind: str, found: FrameValues, unit: str) -> None:
    """Arrays without gaps: a predictor has frames only where it was compared."""
    index: dict[str, list[MotionSequence]] = {}
    values: dict[str, list[NDArray[np.float32]]] = {}
    for sequence, by_name in found:
        for name, frames_m in by_name.items():
            start = sum(map(len, values.setdefault(name, [])))
            place = replace(sequence, start=start, length=len(frames_m))
            index.setdefault(name, []).append(place)
            values[name].append(frames_m)
    for name, parts in values.items():
        writer.put(f"{kind}_{name}", np.concatenate(parts), unit)
    writer.record(
        **{f"{kind}_sequences": {name: to_manifest(places) for name, places in index.items()}}
    )
