"""`dsnet evaluate`: errors of every pipeline's predictions, beside what learns nothing.

One pass over the sequences gives a table with a row for each; of a group of sequences, sums of its
rows give the figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_paper_body
from bridge.errors import notify
from bridge.motion import MotionSequence, to_manifest
from bridge.motion.sequences import end_to_end
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import INFER_PLUS, body_model_path
from bridge.runs.workers import progress, worker_pool
from dsnet.evaluation.alignment import alignment_errors
from dsnet.evaluation.comparison import Evaluation, SequenceErrors
from dsnet.evaluation.metrics import GroupErrors, SpectrumSums
from dsnet.evaluation.pipelines import MotionArrays, Pipeline, pipelines_of, stages_of_pipelines

MESH_ERROR, OFFSET_SIZE = "mesh_error", "offset_size"
_TEST_BED = {"tissue": "own", "form": "clean", "gravity": True, "gender": None}


def evaluate_run(run: Run) -> None:
    """Measure every prediction of a run, saying what it lacks; a current result is kept."""
    upstream = run.artifacts(*stages_of_pipelines(run))
    pipelines = pipelines_of(upstream)
    origin = pipelines[0].align.artifact.origin
    # The truth belongs to the run's own corpus, not to licensed meshes aligned beside it.
    whole = {"decode", INFER_PLUS} | ({"truth"} if origin == "synthetic" else set())
    if "truth" in whole and run.finished("truth"):
        upstream["truth"] = run.artifact("truth")
    if absent := sorted(whole - set(upstream)):
        notify(f"run {run.name!r} is evaluated without {', '.join(absent)}, which it does not have")
    body = load_paper_body(str(body_model_path(run)))
    run.build(
        "evaluate",
        {},
        lambda writer: evaluate_pipelines(writer, pipelines, upstream.get("truth"), body),
        data=origin,
        upstream=upstream,
    )


def evaluate_pipelines(
    writer: ArtifactWriter,
    pipelines: Sequence[Pipeline],
    truth: Artifact | None,
    body: BodyModelData,
) -> None:
    """Fill an artifact with the errors of every predictor, the first pipeline's sequences first."""
    known = None if truth is None else MotionArrays.of(truth)
    evaluation = Evaluation(pipelines, known, body)
    sequences = evaluation.sequences()
    table: list[SequenceErrors] = []
    described: list[dict[str, Any]] = []
    groups: dict[str, dict[str, GroupErrors]] = {}
    with worker_pool("threads", evaluation) as pool:
        rows = pool.map(Evaluation.compare, sequences)
        for row in progress(rows, what="evaluate", unit="sequence", total=len(sequences)):
            described.append(_described(row, evaluation))
            for group in evaluation.groups(row.sequence):
                for name, errors in row.errors.items():
                    groups.setdefault(group, {}).setdefault(name, GroupErrors()).add(errors)
            # Its sums are in the groups', and take a megabyte or more.
            table.append(replace(row, errors={}))
    _put_frames(writer, MESH_ERROR, [(row.sequence, row.mesh_error_m) for row in table])
    _put_frames(writer, OFFSET_SIZE, [(row.sequence, row.offset_size_m) for row in table])
    for name, found in groups.get("test", {}).items():
        if isinstance(spectrum := found.sums.get("spectrum"), SpectrumSums):
            writer.put(f"spectrum_{name}", spectrum.rms_mm(), "mm; true, predicted, error")
    writer.record(
        sequences=to_manifest(sequences),
        predictors={name: one.label for name, one in evaluation.candidates.items()},
        default=pipelines[-1].default,
        pipelines={one.name: _described_pipeline(one) for one in pipelines},
        test_bed=None if truth is None else _test_bed(truth, body),
        per_sequence=described,
        cells={
            group: {name: errors.summary() for name, errors in by_name.items()}
            for group, by_name in groups.items()
        },
        alignments={one.alignment: alignment_errors(one.align, known, body) for one in pipelines},
    )


def _described(row: SequenceErrors, evaluation: Evaluation) -> dict[str, Any]:
    sequence = row.sequence
    return {
        "name": sequence.name,
        "subject": sequence.subject,
        "motion": sequence.motion,
        "split": sequence.split,
        "cell": evaluation.groups(sequence)[-1],
        "person": "known" if evaluation.knows(sequence) else "new",
        "frames": sequence.length,
        "errors": {
            name: {measure: sums.summary() for measure, sums in errors.items()}
            for name, errors in row.errors.items()
        },
    }


def _described_pipeline(pipeline: Pipeline) -> dict[str, Any]:
    return {
        "predictors": list(pipeline.predictors),
        "default": pipeline.default,
        "alignment": pipeline.alignment,
        "aligner": pipeline.align.artifact.manifest["config"].get("aligner"),
    }


def _test_bed(truth: Artifact, body: BodyModelData) -> dict[str, Any]:
    """Law and form of the tissue, whether gravity loads it, and whose bodies."""
    known = {key: truth.manifest.get(key, usual) for key, usual in _TEST_BED.items()}
    return known | {"gender": known["gender"] or body.gender}


def _put_frames(
    writer: ArtifactWriter,
    kind: str,
    rows: Iterable[tuple[MotionSequence, Mapping[str, NDArray[np.float32]]]],
) -> None:
    """An array for each predictor, without gaps where it was not compared, and an index of it."""
    places: dict[str, list[MotionSequence]] = {}
    values: dict[str, list[NDArray[np.float32]]] = {}
    for sequence, by_name in rows:
        for name, frames in by_name.items():
            places.setdefault(name, []).append(replace(sequence, length=len(frames)))
            values.setdefault(name, []).append(frames)
    for name, parts in values.items():
        writer.put(f"{kind}_{name}", np.concatenate(parts), "m, mean over vertices")
    index = {name: to_manifest(end_to_end(own)) for name, own in places.items()}
    writer.record(**{f"{kind}_sequences": index})


def frames_m(
    evaluate: Artifact, kind: str, predictor: str, sequence: str
) -> NDArray[np.float32] | None:
    """(T,) value of each frame, mean over vertices, metres; None if not measured.

    `MESH_ERROR` of a predictor; `OFFSET_SIZE`, length of the moving offsets, of one or of `TRUE`.
    """
    entries = evaluate.manifest[f"{kind}_sequences"].get(predictor, [])
    place = next((MotionSequence(**one) for one in entries if one["name"] == sequence), None)
    return None if place is None else evaluate.array(f"{kind}_{predictor}")[place.frames]
