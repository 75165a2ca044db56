"""`dsnet evaluate`: errors of every pipeline's predictions and of the baselines.

One pass over the sequences gives errors of each; those of a group of sequences are their sums.
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
    """Measure every prediction of a run, with a note about stages that it lacks.

    An artifact that is up to date is kept. DsnetError where predictions were begun and not ended.
    """
    run.refuse_interrupted("decode", INFER_PLUS)
    upstream = run.artifacts(*stages_of_pipelines(run))
    pipelines = pipelines_of(upstream)
    origin = pipelines[0].align.artifact.origin
    # A truth is that of the run's synthetic corpus; ignore it if licensed meshes were aligned.
    expected = {"decode", INFER_PLUS} | ({"truth"} if origin == "synthetic" else set())
    if "truth" in expected and run.finished("truth"):
        upstream["truth"] = run.artifact("truth")
    if absent := sorted(expected - set(upstream)):
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
    """Write the errors of every predictor into an artifact, in the first pipeline's order."""
    true = None if truth is None else MotionArrays.of(truth)
    evaluation = Evaluation(pipelines, true, body)
    sequences = evaluation.sequences()
    table: list[SequenceErrors] = []
    entries: list[dict[str, Any]] = []
    groups: dict[str, dict[str, GroupErrors]] = {}
    with worker_pool("threads", evaluation) as pool:
        rows = pool.map(Evaluation.compare, sequences)
        for row in progress(rows, what="evaluate", unit="sequence", total=len(sequences)):
            entries.append(_sequence_entry(row, evaluation))
            for group in evaluation.groups(row.sequence):
                for name, errors in row.errors.items():
                    groups.setdefault(group, {}).setdefault(name, GroupErrors()).add(errors)
            # Drop the sums, which take a megabyte or more and are in those of the groups.
            table.append(replace(row, errors={}))
    _put_per_frame(writer, MESH_ERROR, [(row.sequence, row.mesh_error_m) for row in table])
    _put_per_frame(writer, OFFSET_SIZE, [(row.sequence, row.offset_size_m) for row in table])
    for name, group_errors in groups.get("test", {}).items():
        if isinstance(spectrum := group_errors.sums.get("spectrum"), SpectrumSums):
            writer.put(f"spectrum_{name}", spectrum.rms_mm(), "mm; true, predicted, error")
    writer.record(
        sequences=to_manifest(sequences),
        predictors={name: one.label for name, one in evaluation.candidates.items()},
        default=pipelines[-1].default,
        pipelines={one.name: _pipeline_entry(one) for one in pipelines},
        test_bed=None if truth is None else _test_bed(truth, body),
        per_sequence=entries,
        cells={
            group: {name: errors.summary() for name, errors in by_name.items()}
            for group, by_name in groups.items()
        },
        alignments={one.alignment: alignment_errors(one.align, true, body) for one in pipelines},
    )


def _sequence_entry(row: SequenceErrors, evaluation: Evaluation) -> dict[str, Any]:
    sequence = row.sequence
    return {
        "name": sequence.name,
        "subject": sequence.subject,
        "motion": sequence.motion,
        "split": sequence.split,
        "cell": evaluation.groups(sequence)[-1],
        "person": "known" if evaluation.is_training_subject(sequence) else "new",
        "frames": sequence.length,
        "errors": {
            name: {measure: sums.summary() for measure, sums in errors.items()}
            for name, errors in row.errors.items()
        },
    }


def _pipeline_entry(pipeline: Pipeline) -> dict[str, Any]:
    return {
        "predictors": list(pipeline.predictors),
        "default": pipeline.default,
        "alignment": pipeline.alignment,
        "aligner": pipeline.align.artifact.manifest["config"].get("aligner"),
    }


def _test_bed(truth: Artifact, body: BodyModelData) -> dict[str, Any]:
    """How the synthetic data were made: tissue law, form of the meshes, gravity, gender."""
    bed = {key: truth.manifest.get(key, default) for key, default in _TEST_BED.items()}
    return bed | {"gender": bed["gender"] or body.gender}


def _put_per_frame(
    writer: ArtifactWriter,
    kind: str,
    rows: Iterable[tuple[MotionSequence, Mapping[str, NDArray[np.float32]]]],
) -> None:
    """Write one array for each predictor with the sequences it has, end to end, and their index."""
    sequences: dict[str, list[MotionSequence]] = {}
    values: dict[str, list[NDArray[np.float32]]] = {}
    for sequence, by_name in rows:
        for name, frames in by_name.items():
            sequences.setdefault(name, []).append(replace(sequence, length=len(frames)))
            values.setdefault(name, []).append(frames)
    for name, parts in values.items():
        writer.put(f"{kind}_{name}", np.concatenate(parts), "m, mean over vertices")
    index = {name: to_manifest(end_to_end(listed)) for name, listed in sequences.items()}
    writer.record(**{f"{kind}_sequences": index})


def per_frame_m(
    evaluate: Artifact, kind: str, predictor: str, sequence: str
) -> NDArray[np.float32] | None:
    """(T,) value of each frame, mean over vertices, metres; None if not measured.

    `kind` is `MESH_ERROR`, or `OFFSET_SIZE` for the length of the moving offsets (also of `TRUE`).
    """
    entries = evaluate.manifest[f"{kind}_sequences"].get(predictor, [])
    entry = next((MotionSequence(**one) for one in entries if one["name"] == sequence), None)
    return None if entry is None else evaluate.array(f"{kind}_{predictor}")[entry.frames]
