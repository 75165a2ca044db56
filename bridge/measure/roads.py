"""The roads of a run: the paper's, through autoencoder and latents, and the best, without them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from bridge.errors import DsnetError, did_you_mean
from bridge.motion import MotionSequence, sequences_of
from bridge.runs import Artifact, Run

PAPER, BEST = "paper", "best"
TRAIN_PLUS, PREDICT_PLUS = "train_plus", "predict_plus"


@dataclass(frozen=True)
class Road:
    """One way from meshes to predicted offsets; a prediction belongs to its own alignment."""

    name: str
    """`paper` or `best`."""
    alignment: str
    """Name of the artifact that holds the alignment."""
    align: Artifact
    """Shapes, poses and offsets of the aligned sequences."""
    motions: Artifact
    """`theta` and `betas` that the predictors were given."""
    offsets: Artifact
    """`offsets_<predictor>`, and `static_<predictor>` of one that tells the two apart."""

    @property
    def predictors(self) -> dict[str, str]:
        """Labels by name, that of the road's default first."""
        labels: dict[str, str] = self.offsets.manifest["predictors"]
        return {self.default: labels[self.default]} | labels

    @property
    def default(self) -> str:
        """The predictor that stands for the road."""
        manifest = self.offsets.manifest
        return str(manifest.get("default") or next(iter(manifest["predictors"])))

    @cached_property
    def sequences(self) -> Mapping[str, MotionSequence]:
        """Sequences with predicted offsets, by name."""
        return {sequence.name: sequence for sequence in sequences_of(self.offsets)}

    @cached_property
    def aligned(self) -> Mapping[str, MotionSequence]:
        """Aligned sequences by name."""
        return {sequence.name: sequence for sequence in sequences_of(self.align)}


def stages_of_roads(run: Run) -> list[str]:
    """The stages whose artifacts make the roads that the run went to their end; else the paper's.

    Raises
    ------
    DsnetError
        If the best road is older than what it was made from.
    """
    names: list[str] = []
    if run.finished("decode") or not run.finished(PREDICT_PLUS):
        names += ["align", "predict", "decode"]
    if run.finished(PREDICT_PLUS):
        names += [_alignment_of(run.artifact(PREDICT_PLUS)), PREDICT_PLUS]
    return list(dict.fromkeys(names))


def roads_of(artifacts: Mapping[str, Artifact]) -> list[Road]:
    """The roads among a run's artifacts, the paper's first.

    Parameters
    ----------
    artifacts : those of `stages_of_roads`; others may be among them.
    """
    roads = []
    if "decode" in artifacts:
        roads.append(
            Road(PAPER, "align", artifacts["align"], artifacts["predict"], artifacts["decode"])
        )
    if PREDICT_PLUS in artifacts:
        plus = artifacts[PREDICT_PLUS]
        alignment = _alignment_of(plus)
        roads.append(Road(BEST, alignment, artifacts[alignment], plus, plus))
    return roads


def road_of(roads: Iterable[Road], predictor: str) -> Road:
    """The road that a predictor belongs to.

    Raises
    ------
    DsnetError
        If no road of the run has such a predictor.
    """
    known: list[str] = []
    for road in roads:
        if predictor in road.predictors:
            return road
        known += road.predictors
    remedy = did_you_mean(predictor, known, "Check its name, or train it.")
    raise DsnetError(f"predictor {predictor!r}", f"one of {', '.join(known)}", remedy)


def _alignment_of(plus: Artifact) -> str:
    """The artifact that the best road was aligned by: `align` itself if there is no other."""
    robust = "align_robust"
    return robust if robust in plus.manifest["upstream"] else "align"
