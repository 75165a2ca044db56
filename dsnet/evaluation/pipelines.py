"""The pipelines of a run, their predictors, and the baselines they are compared with.

The paper's pipeline predicts latents of the autoencoder, the best one predicts offsets directly.
Each has its own alignment, and with it its own poses and shapes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.dsnet import LITERAL_DSNETS
from bridge.motion import MotionSequence, sequences_of, shape_rows
from bridge.runs import Artifact, Run
from bridge.runs.run import INFER, INFER_PLUS
from dsnet.evaluation.metrics import frame_blocks

PAPER, BEST = "paper", "best"
AUTOENCODER, SMPL = "autoencoder", "smpl"
SUBJECT_MEAN, SEQUENCE_MEAN = "person_mean", "sequence_mean"
BASELINES = {
    AUTOENCODER: "autoencoder alone, given the aligned offsets",
    SUBJECT_MEAN: "the person's mean offset over training",
    SEQUENCE_MEAN: "the sequence's own best constant (oracle)",
    SMPL: "SMPL alone",
}
"""Labels of the baselines that trained predictors are compared with, in the order of the tables."""
TEST_SUBJECT = ""
"""Stands for every subject without training frames."""


@dataclass(frozen=True, eq=False)
class MotionArrays:
    """An artifact's theta, betas and perhaps offsets, by name of sequence."""

    artifact: Artifact
    sequences: Mapping[str, MotionSequence]
    """By name, with the frames that each has in the arrays."""
    rows: Mapping[str, int]
    """Row of each sequence in `betas`; none where the artifact has no betas."""

    @classmethod
    def of(cls, artifact: Artifact) -> MotionArrays:
        sequences = sequences_of(artifact)
        has_betas = "betas" in artifact.manifest["arrays"]
        rows = shape_rows(sequences, artifact.array("betas")) if has_betas else {}
        return cls(artifact, {one.name: one for one in sequences}, rows)

    def betas(self, name: str) -> NDArray:
        """(10,) betas of the sequence."""
        return self.artifact.array("betas")[self.rows[name]]

    def frames(
        self, array: str, name: str, frames: slice | NDArray, vertices: slice = slice(None)
    ) -> NDArray:
        """Frames of an array, counted from the sequence's first frame; may be memory-mapped."""
        return self.artifact.array(array)[self.sequences[name].frames][frames][:, vertices]

    def has(self, array: str) -> bool:
        return array in self.artifact.manifest["arrays"]

    def offsets_m(self, name: str, frames: slice, vertices: slice = slice(None)) -> NDArray:
        """(B, V, 3) total offsets, metres: the moving part, and the static one if there is one."""
        moving_m = self.frames("offsets", name, frames, vertices)
        if not self.has("static"):
            return moving_m
        return moving_m + self.frames("static", name, frames, vertices)


@dataclass(frozen=True, eq=False)
class Pipeline:
    """One way from meshes to predicted offsets."""

    name: str
    """`paper` or `best`."""
    align: MotionArrays
    """Shapes, poses and offsets of the aligned sequences."""
    motions: MotionArrays
    """`theta` and `betas`, the inputs of the predictors."""
    offsets: MotionArrays
    """`offsets_<predictor>`, and `static_<predictor>` of predictors that separate the two."""

    @property
    def alignment(self) -> str:
        return self.align.artifact.path.name

    @property
    def default(self) -> str:
        """The pipeline's main predictor."""
        manifest = self.offsets.artifact.manifest
        return str(manifest.get("default") or next(iter(manifest["predictors"])))

    @property
    def predictors(self) -> dict[str, str]:
        """Labels of the predictors by name: the paper's words alone first, then the default."""
        labels: dict[str, str] = self.offsets.artifact.manifest["predictors"]
        first = [name for name in LITERAL_DSNETS.values() if name in labels]
        return {name: labels[name] for name in (*first, self.default, *labels)}

    def predicted_m(
        self, predictor: str, name: str, frames: slice | NDArray, vertices: slice = slice(None)
    ) -> NDArray:
        """(B, V, 3) offsets that a predictor, or the autoencoder, gives for a sequence, metres."""
        return self.offsets.frames(f"offsets_{predictor}", name, frames, vertices)


def stages_of_pipelines(run: Run) -> list[str]:
    """The stages of the pipelines that the run has finished; those of the paper's if of none."""
    names: list[str] = []
    if run.finished("decode") or not run.finished(INFER_PLUS):
        names += ["align", INFER, "decode"]
    if run.finished(INFER_PLUS):
        names += [_alignment_of(run.artifact(INFER_PLUS)), INFER_PLUS]
    return list(dict.fromkeys(names))


def pipelines_of(artifacts: Mapping[str, Artifact]) -> list[Pipeline]:
    """The pipelines of a run's artifacts (see `stages_of_pipelines`), the paper's first."""
    arrays = {}
    if "decode" in artifacts:
        arrays[PAPER] = ("align", INFER, "decode")
    if INFER_PLUS in artifacts:
        arrays[BEST] = (_alignment_of(artifacts[INFER_PLUS]), INFER_PLUS, INFER_PLUS)
    return [
        Pipeline(name, *(MotionArrays.of(artifacts[stage]) for stage in stages))
        for name, stages in arrays.items()
    ]


def _alignment_of(plus: Artifact) -> str:
    """The alignment that the best pipeline was trained on."""
    robust = "align_robust"
    return robust if robust in plus.manifest["upstream"] else "align"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A trained predictor or a baseline, with the motions and alignment of a pipeline."""

    name: str
    """Key of the results: the predictor's name; `<kind>_<pipeline>` of a second baseline."""
    kind: str
    """The trained predictor's name, or a key of `BASELINES`."""
    label: str
    pipeline: Pipeline
    means_m: Mapping[str, NDArray[np.float64]]
    """Mean offsets (V, 3) by subject, for baselines."""

    @property
    def moves(self) -> bool:
        """Whether its offsets change over time; if not, it has no velocity and no spectrum."""
        return self.kind not in (SUBJECT_MEAN, SEQUENCE_MEAN, SMPL)

    def predicts(self, sequence: str) -> bool:
        """Whether it has offsets of a sequence; the autoencoder has those of aligned ones only."""
        aligned = self.kind != AUTOENCODER or sequence in self.pipeline.align.sequences
        return aligned and sequence in self.pipeline.offsets.sequences

    def offsets_m(self, sequence: str, frames: slice, vertices: slice = slice(None)) -> NDArray:
        """(B, V, 3), or (1, V, 3) where they are constant, metres; not for `SEQUENCE_MEAN`."""
        if self.kind == SMPL:
            return np.zeros_like(self.means_m[TEST_SUBJECT])[None, vertices]
        if self.kind == SUBJECT_MEAN:
            subject = self.pipeline.offsets.sequences[sequence].subject
            return self.means_m.get(subject, self.means_m[TEST_SUBJECT])[None, vertices]
        return self.pipeline.predicted_m(self.kind, sequence, frames, vertices)

    def static_m(self, sequence: str, frames: slice, vertices: slice) -> NDArray | None:
        """(B, V, 3) the static part of the offsets; None if the predictor does not separate it."""
        array = f"static_{self.kind}"
        if not self.pipeline.offsets.has(array):
            return None
        return self.pipeline.offsets.frames(array, sequence, frames, vertices)


def candidates(pipelines: Sequence[Pipeline]) -> dict[str, Candidate]:
    """All predictors and baselines in the order of the tables, the last pipeline's first."""
    chosen = [
        Candidate(name, name, label, pipeline, {})
        for pipeline in reversed(pipelines)
        for name, label in pipeline.predictors.items()
    ]
    first = pipelines[0]
    means_m = mean_offsets_m(first.align)
    for kind, label in BASELINES.items():
        if kind != AUTOENCODER or first.offsets.has(f"offsets_{AUTOENCODER}"):
            chosen.append(Candidate(kind, kind, label, first, means_m))
    for other in pipelines[1:]:
        # Baselines of a second pipeline differ only if its alignment does.
        if other.align.artifact.content_sha256 != first.align.artifact.content_sha256:
            means_m = mean_offsets_m(other.align)
            for kind in (SUBJECT_MEAN, SMPL):
                label = f"{BASELINES[kind]}, in the {other.name} pipeline"
                chosen.append(Candidate(f"{kind}_{other.name}", kind, label, other, means_m))
    return {one.name: one for one in chosen}


def mean_offsets_m(align: MotionArrays) -> dict[str, NDArray[np.float64]]:
    """Mean aligned offsets (V, 3) of each subject over the training frames, metres.

    `TEST_SUBJECT` has the mean over subjects.
    """
    offsets_m = align.artifact.array("offsets")
    sums_m: dict[str, NDArray[np.float64]] = {}
    frames = Counter[str]()
    for sequence in align.sequences.values():
        if sequence.split == "train":
            for block in frame_blocks(sequence.frames):
                sum_m = offsets_m[block].sum(axis=0, dtype=np.float64)
                sums_m[sequence.subject] = sums_m.get(sequence.subject, 0.0) + sum_m
            frames[sequence.subject] += sequence.length
    means = {subject: sum_m / frames[subject] for subject, sum_m in sums_m.items()}
    fallback = [np.zeros(offsets_m.shape[1:])]
    return means | {TEST_SUBJECT: np.mean(list(means.values()) or fallback, axis=0)}
