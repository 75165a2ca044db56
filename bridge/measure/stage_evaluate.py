"""`dsnet evaluate`: errors of the predictions against the meshes, and of two that learn nothing."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import BodyModelData, load_body_model
from bridge.measure.alignment_quality import alignment_errors
from bridge.measure.mesh_errors import blended_rotations
from bridge.measure.metrics import ErrorSums, frame_blocks, mean_offset_m
from bridge.motion import MotionSequence, sequences_of, subject_rows, unpack_theta
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.artifact import MANIFEST
from bridge.runs.run import body_model_path

PREDICTORS = ("dsnet", "dsnet_faithful", "autoencoder", "smpl", "mean_offset")
_DECODED = {
    "dsnet": "offsets",
    "dsnet_faithful": "offsets_faithful",
    "autoencoder": "offsets_autoencoder",
}


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure every prediction: about 15 ms a frame, less than 1 GB.

    Gives R2 and errors against the aligned offsets, which a licensed user has too, and, for
    synthetic data only, against the truth; and the error of the posed mesh in each frame.
    """

    run: str = "demo"
    """Run to evaluate."""
    seed: int = 0
    """Recorded; nothing here is random."""


PROFILES = {name: EvaluateConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: EvaluateConfig) -> None:
    """Run the stage; a result that is current is kept.

    Raises
    ------
    DsnetError
        If the run lacks one of the stages before this one.
    """
    run = Run(config.run)
    upstream = {stage: run.artifact(stage) for stage in ("align", "predict", "decode")}
    # The truth belongs to the run's own corpus, not to licensed meshes aligned beside it.
    if upstream["align"].origin == "synthetic" and (run.path / "truth" / MANIFEST).is_file():
        upstream["truth"] = run.artifact("truth")
    body = load_body_model(str(body_model_path(run)))
    run.build(
        "evaluate",
        config,
        lambda writer: Evaluation(upstream, body).write(writer),
        data=upstream["align"].origin,
        upstream=upstream,
    )


@dataclass(frozen=True)
class Reference:
    """Offsets to compare with: the aligned ones, or the synthetic truth."""

    name: str
    offsets_m: NDArray[np.float32]
    places: Mapping[str, MotionSequence]

    @classmethod
    def of(cls, name: str, artifact: Artifact) -> Reference:
        """The offsets of an artifact by name of sequence."""
        return cls(name, artifact.array("offsets"), {s.name: s for s in sequences_of(artifact)})


class Evaluation:
    """All comparisons of one run."""

    def __init__(self, upstream: Mapping[str, Artifact], body: BodyModelData) -> None:
        self._upstream, self._body = upstream, body
        self._decode, self._predict = upstream["decode"], upstream["predict"]
        sources = {"align": "aligned", "truth": "truth"}
        self._references = [
            Reference.of(name, upstream[stage])
            for stage, name in sources.items()
            if stage in upstream
        ]
        self._places = {s.name: s for s in sequences_of(self._predict)}
        self._rows = subject_rows(self._places.values())

    def write(self, writer: ArtifactWriter) -> None:
        """Fill the `evaluate` artifact."""
        sequences = sequences_of(self._decode)
        frames = sum(sequence.length for sequence in sequences)
        mesh_m = {name: np.full(frames, np.nan, np.float32) for name in PREDICTORS}
        splits: dict[str, Any] = {}
        results = []
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            compared = pool.map(lambda one: self._compare_all(one, mesh_m), sequences)
            bar = tqdm(
                zip(sequences, compared, strict=True),
                desc="evaluate",
                total=len(sequences),
                unit="sequence",
                disable=None,
            )
            for sequence, by_reference in bar:
                errors = {}
                for reference, sums in by_reference.items():
                    errors[reference] = {name: one.summary() for name, one in sums.items()}
                    pooled = splits.setdefault(sequence.split, {}).setdefault(reference, {})
                    for name, one in sums.items():
                        pooled.setdefault(name, ErrorSums()).merge(one)
                results.append(_describe(sequence, errors, mesh_m))
        for name, errors_m in mesh_m.items():
            writer.put(f"mesh_error_{name}", errors_m, "m, mean over vertices")
        writer.record(
            sequences=self._decode.manifest["sequences"],
            per_sequence=results,
            splits=_summaries(splits),
            alignment=alignment_errors(
                self._upstream["align"], self._upstream.get("truth"), self._body
            ),
            reading=self._predict.manifest.get("reading"),
        )

    def _compare_all(
        self, sequence: MotionSequence, mesh_m: dict[str, NDArray[np.float32]]
    ) -> dict[str, dict[str, ErrorSums]]:
        """Errors of one sequence by reference; `mesh_m` receives those against the first."""
        return {
            reference.name: self._compare(sequence, reference, None if index else mesh_m)
            for index, reference in enumerate(self._applicable(sequence))
        }

    def _applicable(self, sequence: MotionSequence) -> Iterator[Reference]:
        return (r for r in self._references if sequence.name in r.places)

    def _compare(
        self,
        sequence: MotionSequence,
        reference: Reference,
        mesh_m: dict[str, NDArray[np.float32]] | None,
    ) -> dict[str, ErrorSums]:
        """Errors of one sequence; `mesh_m` receives those of its posed frames."""
        place = reference.places[sequence.name]
        length = min(sequence.length, place.length)
        mean = mean_offset_m(reference.offsets_m, slice(place.start, place.start + length))
        sums = {name: ErrorSums() for name in self._predictors(sequence)}
        for block in frame_blocks(slice(0, length)):
            target = reference.offsets_m[place.start + block.start : place.start + block.stop]
            own = slice(sequence.start + block.start, sequence.start + block.stop)
            turned = None if mesh_m is None else self._rotations(sequence, block)
            for name, one in sums.items():
                predicted = self._offsets(name, own, mean)
                one.add(np.broadcast_to(predicted, target.shape), target)
                if mesh_m is not None and turned is not None:
                    posed = np.einsum("bvxy,bvy->bvx", turned, predicted - target)
                    mesh_m[name][own] = np.linalg.norm(posed, axis=-1).mean(axis=1)
        return sums

    def _predictors(self, sequence: MotionSequence) -> list[str]:
        """Test sequences have no aligned offsets for the autoencoder to encode."""
        having = self._decode.manifest["arrays"]
        return [
            name
            for name in PREDICTORS
            if not (name == "autoencoder" and sequence.split == "test")
            and (name not in _DECODED or _DECODED[name] in having)
        ]

    def _offsets(self, predictor: str, frames: slice, mean: NDArray) -> NDArray:
        if predictor in _DECODED:
            return self._decode.array(_DECODED[predictor])[frames]
        return mean[None] if predictor == "mean_offset" else np.zeros_like(mean)[None]

    def _rotations(self, sequence: MotionSequence, block: slice) -> NDArray[np.float64]:
        place = self._places[sequence.name]
        theta = self._predict.array("theta")[place.start + block.start : place.start + block.stop]
        betas = self._predict.array("betas")[self._rows[sequence.subject]]
        return blended_rotations(self._body, betas, unpack_theta(theta)[0])


def _describe(
    sequence: MotionSequence, errors: dict[str, Any], mesh_m: Mapping[str, NDArray[np.float32]]
) -> dict[str, Any]:
    posed = {}
    for name, values in mesh_m.items():
        own = 1e3 * values[sequence.frames]
        if np.isfinite(own).all():
            posed[name] = {
                "mean": float(own.mean()),
                "min": float(own.min()),
                "max": float(own.max()),
            }
    return {
        "name": sequence.name,
        "subject": sequence.subject,
        "motion": sequence.motion,
        "split": sequence.split,
        "frames": sequence.length,
        "errors": errors,
        "mesh_frame_error_mm": posed,
    }


def _summaries(splits: Mapping[str, Any]) -> dict[str, Any]:
    return {
        split: {
            reference: {name: one.summary() for name, one in pooled.items()}
            for reference, pooled in references.items()
        }
        for split, references in splits.items()
    }
