"""`dsnet evaluate`: errors of the predictions' posed meshes, beside what learns nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import BodyModelData, load_body_model
from bridge.measure.alignment_quality import alignment_errors
from bridge.measure.metrics import ErrorSums, FrameErrors, jackknife_r2_se
from bridge.measure.predictions import SEQUENCE_MEAN, Predictions
from bridge.measure.references import References, best_constant_m
from bridge.motion import MotionSequence, sequences_of, to_manifest
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import body_model_path
from bridge.runs.worker_pool import worker_pool

Errors = Mapping[str, Mapping[str, FrameErrors]]


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure every prediction: about 5 ms a frame, 1 GB.

    Gives R2 and errors of the posed meshes against the registered ones, which a licensed user has
    too, for synthetic data also against the true meshes of unseen motions and against the true
    offsets; and the error of the posed mesh in each frame.
    """

    run: str = "demo"
    """Run to evaluate."""


PROFILES = {name: EvaluateConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: EvaluateConfig) -> None:
    """Run the stage; a result that is current is kept.

    Raises
    ------
    DsnetError
        If the run lacks one of the stages before this one.
    """
    run = Run(config.run)
    upstream = run.artifacts("align", "predict", "decode")
    # The truth belongs to the run's own corpus, not to licensed meshes aligned beside it.
    if upstream["align"].origin == "synthetic" and run.finished("truth"):
        upstream["truth"] = run.artifact("truth")
    body = load_body_model(str(body_model_path(run)))
    run.build(
        "evaluate",
        config,
        lambda writer: Evaluation(upstream, body).write(writer),
        data=upstream["align"].origin,
        upstream=upstream,
    )


class Evaluation:
    """All comparisons of one run.

    Parameters
    ----------
    upstream : artifacts `align`, `predict`, `decode` and, for synthetic data, `truth`.
    """

    def __init__(self, upstream: Mapping[str, Artifact], body: BodyModelData) -> None:
        self._align, self._predict = upstream["align"], upstream["predict"]
        self._truth, self._body = upstream.get("truth"), body
        self._decode = upstream["decode"]
        self._predictions = Predictions(self._decode, self._align)
        self._references = References(body, self._predict, self._align, self._truth)

    def write(self, writer: ArtifactWriter) -> None:
        """Fill the `evaluate` artifact."""
        sequences = sequences_of(self._decode)
        with worker_pool("threads", self) as pool:
            compared = tqdm(
                pool.map(Evaluation.compare, sequences),
                desc="evaluate",
                total=len(sequences),
                unit="sequence",
                disable=None,
            )
            found = list(zip(sequences, compared, strict=True))
        writer.record(
            sequences=self._decode.manifest["sequences"],
            predictors=self._predictions.labels,
            default=self._predictions.default,
            per_sequence=[self._describe(*one) for one in found],
            splits=_pooled((self.cells(sequence), errors) for sequence, errors in found),
            mesh_error_sequences=_write_frame_errors(writer, found),
            alignment=alignment_errors(self._align, self._truth, self._body),
        )

    def compare(self, sequence: MotionSequence) -> Errors:
        """Errors of one sequence, by reference and predictor."""
        return {
            reference: self._compare(sequence, reference)
            for reference in self._references.of(sequence.name)
        }

    def cells(self, sequence: MotionSequence) -> list[str]:
        """Groups of sequences whose errors are pooled."""
        if sequence.split != "test":
            return [sequence.split]
        known = self._predictions.knows(sequence.subject)
        return ["test", "test_known_person" if known else "test_new_person"]

    def _compare(self, sequence: MotionSequence, reference: str) -> dict[str, FrameErrors]:
        constant_m = best_constant_m(self._references.blocks(sequence.name, reference))[None]
        found = {name: FrameErrors() for name in self._predictions.of(sequence)}
        for block in self._references.blocks(sequence.name, reference):
            for name, errors in found.items():
                offsets_m = (
                    constant_m
                    if name == SEQUENCE_MEAN
                    else self._predictions.offsets_m(name, sequence, block.frames)
                )
                errors.add(block.carry(offsets_m), block.lacking_m)
        return found

    def _describe(self, sequence: MotionSequence, errors: Errors) -> dict[str, Any]:
        return {
            "name": sequence.name,
            "subject": sequence.subject,
            "motion": sequence.motion,
            "split": sequence.split,
            "person": "known" if self._predictions.knows(sequence.subject) else "new",
            "frames": sequence.length,
            "errors": {
                reference: {name: one.sums.summary() for name, one in found.items()}
                for reference, found in errors.items()
            },
            "mesh_frame_error_mm": {
                name: one.frame_summary_mm() for name, one in errors.get("mesh", {}).items()
            },
        }


def frame_errors_m(evaluate: Artifact, predictor: str, sequence: str) -> NDArray[np.float32] | None:
    """(T,) error of the posed mesh in each frame, mean over its vertices; None if not measured."""
    entries = evaluate.manifest["mesh_error_sequences"][predictor]
    place = next((MotionSequence(**one) for one in entries if one["name"] == sequence), None)
    return None if place is None else evaluate.array(f"mesh_error_{predictor}")[place.frames]


def _write_frame_errors(
    writer: ArtifactWriter, found: Iterable[tuple[MotionSequence, Errors]]
) -> dict[str, list[dict[str, Any]]]:
    """Arrays without gaps: a predictor has frames only where it was compared."""
    index: dict[str, list[MotionSequence]] = {}
    values: dict[str, list[NDArray[np.float32]]] = {}
    for sequence, errors in found:
        for name, one in errors.get("mesh", {}).items():
            frames_m = one.frames_m()
            start = sum(map(len, values.setdefault(name, [])))
            place = replace(sequence, start=start, length=len(frames_m))
            index.setdefault(name, []).append(place)
            values[name].append(frames_m)
    for name, parts in values.items():
        writer.put(f"mesh_error_{name}", np.concatenate(parts), "m, mean over vertices")
    return {name: to_manifest(places) for name, places in index.items()}


def _pooled(found: Iterable[tuple[list[str], Errors]]) -> dict[str, Any]:
    """Figures of all sequences of a cell together, by cell, reference and predictor."""
    sums: dict[str, dict[str, dict[str, list[ErrorSums]]]] = {}
    for cells, errors in found:
        for cell, (reference, by_name) in product(cells, errors.items()):
            own = sums.setdefault(cell, {}).setdefault(reference, {})
            for name, one in by_name.items():
                own.setdefault(name, []).append(one.sums)
    return {
        cell: {
            reference: {
                name: ErrorSums.merged(parts).summary() | {"r2_se": jackknife_r2_se(parts)}
                for name, parts in by_name.items()
            }
            for reference, by_name in references.items()
        }
        for cell, references in sums.items()
    }
