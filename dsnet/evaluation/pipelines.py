"""What a run predicted, by which pipeline, and all that evaluation compares.

The paper's pipeline goes through autoencoder and latents, the best one without them. A prediction
belongs to its own alignment.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.motion import MotionSequence, sequences_of, subject_rows
from bridge.runs import Artifact, Run
from bridge.runs.run import INFER, INFER_PLUS
from dsnet.evaluation.metrics import frame_blocks

PAPER, BEST = "paper", "best"
AUTOENCODER, SMPL = "autoencoder", "smpl"
PERSON_MEAN, SEQUENCE_MEAN = "person_mean", "sequence_mean"
LEARN_NOTHING = {
    AUTOENCODER: "autoencoder alone, given the aligned offsets",
    PERSON_MEAN: "the person's mean offset over training",
    SEQUENCE_MEAN: "the sequence's own best constant (oracle)",
    SMPL: "SMPL alone",
}
"""Labels of what stands beside the trained predictors, in the order of the tables."""
NEW_PERSON = ""
"""In place of a subject."""


@dataclass(frozen=True, eq=False)
class MotionArrays:
    """An artifact's theta, betas and perhaps offsets, by name of sequence."""

    artifact: Artifact
    places: Mapping[str, MotionSequence]
    rows: Mapping[str, int]
    """Of people in `betas`."""

    @classmethod
    def of(cls, artifact: Artifact) -> MotionArrays:
        sequences = sequences_of(artifact)
        return cls(artifact, {one.name: one for one in sequences}, subject_rows(sequences))

    def betas(self, name: str) -> NDArray:
        """(10,) shape of the sequence's person."""
        return self.artifact.array("betas")[self.rows[self.places[name].subject]]

    def frames(
        self, array: str, name: str, frames: slice | NDArray, vertices: slice = slice(None)
    ) -> NDArray:
        """Rows of an array, counted from the sequence's first frame; may be memory-mapped."""
        return self.artifact.array(array)[self.places[name].frames][frames][:, vertices]

    def has(self, array: str) -> bool:
        return array in self.artifact.manifest["arrays"]

    def offsets_m(self, name: str, frames: slice, vertices: slice = slice(None)) -> NDArray:
        """(B, V, 3) all that a mesh has over SMPL: what moves, and `static` if there is one."""
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
    """`theta` and `betas` that the predictors were given."""
    offsets: MotionArrays
    """`offsets_<predictor>`, and `static_<predictor>` of one that tells the two apart."""

    @property
    def alignment(self) -> str:
        return self.align.artifact.path.name

    @property
    def default(self) -> str:
        """The predictor that stands for the pipeline."""
        manifest = self.offsets.artifact.manifest
        return str(manifest.get("default") or next(iter(manifest["predictors"])))

    @property
    def predictors(self) -> dict[str, str]:
        """Labels by name, that of the default first."""
        labels: dict[str, str] = self.offsets.artifact.manifest["predictors"]
        return {self.default: labels[self.default]} | labels

    def predicted_m(
        self, predictor: str, name: str, frames: slice | NDArray, vertices: slice = slice(None)
    ) -> NDArray:
        """(B, V, 3) offsets that a predictor, or the autoencoder, gives for a sequence."""
        return self.offsets.frames(f"offsets_{predictor}", name, frames, vertices)


def stages_of_pipelines(run: Run) -> list[str]:
    """The stages whose artifacts make the pipelines that the run finished; else the paper's."""
    names: list[str] = []
    if run.finished("decode") or not run.finished(INFER_PLUS):
        names += ["align", INFER, "decode"]
    if run.finished(INFER_PLUS):
        names += [_alignment_of(run.artifact(INFER_PLUS)), INFER_PLUS]
    return list(dict.fromkeys(names))


def pipelines_of(artifacts: Mapping[str, Artifact]) -> list[Pipeline]:
    """The pipelines among a run's artifacts, those of `stages_of_pipelines`; the paper's first."""
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
    """The artifact that the best pipeline was aligned by: `align` itself if there is no other."""
    robust = "align_robust"
    return robust if robust in plus.manifest["upstream"] else "align"


@dataclass(frozen=True, eq=False)
class Candidate:
    """One predictor, trained or not, measured with the motions and alignment of a pipeline."""

    name: str
    """In tables: the predictor's, in a second pipeline `<kind>_<pipeline>`."""
    kind: str
    """The trained predictor's name, or one of `LEARN_NOTHING`."""
    label: str
    pipeline: Pipeline
    means_m: Mapping[str, NDArray[np.float64]]
    """(V, 3) by person, of what learns nothing."""

    @property
    def moves(self) -> bool:
        """Whether its offsets change: else it has no velocity and no spectrum."""
        return self.kind not in (PERSON_MEAN, SEQUENCE_MEAN, SMPL)

    def predicts(self, sequence: str) -> bool:
        """Whether there are offsets of a sequence: only an aligned one has some to encode."""
        aligned = self.kind != AUTOENCODER or sequence in self.pipeline.align.places
        return aligned and sequence in self.pipeline.offsets.places

    def offsets_m(self, sequence: str, frames: slice, vertices: slice = slice(None)) -> NDArray:
        """(B, V, 3), or (1, V, 3) where they are constant; not of the sequence's own mean."""
        if self.kind == SMPL:
            return np.zeros_like(self.means_m[NEW_PERSON])[None, vertices]
        if self.kind == PERSON_MEAN:
            subject = self.pipeline.offsets.places[sequence].subject
            return self.means_m.get(subject, self.means_m[NEW_PERSON])[None, vertices]
        return self.pipeline.predicted_m(self.kind, sequence, frames, vertices)

    def static_m(self, sequence: str, frames: slice, vertices: slice) -> NDArray | None:
        """(B, V, 3) the static part of the offsets, None of a predictor that tells none."""
        array = f"static_{self.kind}"
        if not self.pipeline.offsets.has(array):
            return None
        return self.pipeline.offsets.frames(array, sequence, frames, vertices)


def candidates(pipelines: Sequence[Pipeline]) -> dict[str, Candidate]:
    """All that is compared, in the order of the tables: the last pipeline's predictors first."""
    found = [
        Candidate(name, name, label, pipeline, {})
        for pipeline in reversed(pipelines)
        for name, label in pipeline.predictors.items()
    ]
    first = pipelines[0]
    means_m = mean_offsets_m(first.align)
    for kind, label in LEARN_NOTHING.items():
        if kind != AUTOENCODER or first.offsets.has(f"offsets_{AUTOENCODER}"):
            found.append(Candidate(kind, kind, label, first, means_m))
    for other in pipelines[1:]:
        # What learns nothing differs only by what alignment made of shape, pose and offsets.
        if other.align.artifact.content_sha256 != first.align.artifact.content_sha256:
            means_m = mean_offsets_m(other.align)
            for kind in (PERSON_MEAN, SMPL):
                label = f"{LEARN_NOTHING[kind]}, in the {other.name} pipeline"
                found.append(Candidate(f"{kind}_{other.name}", kind, label, other, means_m))
    return {one.name: one for one in found}


def mean_offsets_m(align: MotionArrays) -> dict[str, NDArray[np.float64]]:
    """Mean aligned offset (V, 3) of each person over the training frames; `NEW_PERSON` has the mean
    of those."""
    offsets_m = align.artifact.array("offsets")
    sums_m: dict[str, NDArray[np.float64]] = {}
    frames = Counter[str]()
    for sequence in align.places.values():
        if sequence.split == "train":
            for block in frame_blocks(sequence.frames):
                own_m = offsets_m[block].sum(axis=0, dtype=np.float64)
                sums_m[sequence.subject] = sums_m.get(sequence.subject, 0.0) + own_m
            frames[sequence.subject] += sequence.length
    means = {subject: sum_m / frames[subject] for subject, sum_m in sums_m.items()}
    nobody = [np.zeros(offsets_m.shape[1:])]
    return means | {NEW_PERSON: np.mean(list(means.values()) or nobody, axis=0)}
