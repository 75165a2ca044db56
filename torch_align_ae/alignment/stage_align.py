"""Stage `align`: from registered meshes to shapes, poses and dynamic offsets (Section 3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

from tyro.conf import Fixed

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.motion.splits import splits_of_names
from bridge.options import NonNegativeFloat, NonNegativeInt, PositiveFloat
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import ALIGNMENT, ROBUST_ALIGNMENT, corpus_body_path
from torch_align_ae.alignment.paper.corpus_fit import CorpusFit, Effort
from torch_align_ae.alignment.paper.sgd import Descent
from torch_align_ae.alignment.robust import RobustSettings
from torch_align_ae.alignment.robust.corpus_fit import RobustCorpusFit
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.dyna_files import FPS, DynaEntry, DynaReader, of_one_gender

Aligner = Literal["sgd", "robust"]


@dataclass(frozen=True)
class AlignConfig:
    """Align SMPL to every mesh and take the offsets off in the rest pose (Section 3.3, Eq. 5).

    SGD costs 0.4 to 0.9 ms of one core per frame and step; memory does not grow with the
    corpus. Gives `betas`, `theta`, `offsets` and `frame_error`.
    """

    run: str = "demo"
    """Name of the run; its corpus is aligned unless `smpl` and `dyna` are given."""
    smpl: Path | None = None
    """SMPL model file (.npz or .pkl), given together with `dyna`."""
    dyna: tuple[Path, ...] = ()
    """Dyna or D-FAUST HDF5 files, given together with `smpl`."""
    aligner: Literal["sgd", "robust", "both"] = "both"
    """Method: `sgd` is the paper's; `robust` keeps the pose from swallowing the dynamics. `both`
    makes the paper's `align` and, beside it, `align_robust`."""
    robust: Fixed[RobustSettings] = field(default_factory=RobustSettings)
    """Settings of `robust`; the options below are `sgd`'s."""
    steps: NonNegativeInt = 140
    """Steps for each frame after a sequence's first (the paper does not say how many). With
    50, jumps and fast limbs are left behind, beyond 400 nothing is gained (docs/alignment.md)."""
    first_frame_steps: NonNegativeInt = 2000
    """Steps for the pose of a sequence's first frame, its subject's shape being known."""
    shape_steps: NonNegativeInt = 8000
    """Steps for a subject's shape, together with the pose of its very first frame."""
    lr: PositiveFloat = 1e-4
    """Learning rate (paper: 0.0001)."""
    momentum: NonNegativeFloat = 0.9
    """Momentum (paper: 0.9)."""
    validation: tuple[str, ...] = ("50004_one_leg_jump", "50002_one_leg_jump")
    """Sequences held out from training; the last one if the files have none of these."""


PROFILES: dict[str, AlignConfig] = {
    "smoke": AlignConfig(
        run="smoke",
        steps=30,
        first_frame_steps=300,
        shape_steps=1000,
        robust=RobustSettings.fast(),
    ),
    "demo": AlignConfig(run="demo"),
    "paper": AlignConfig(run="paper", steps=400, first_frame_steps=5000, shape_steps=20_000),
}


@dataclass(frozen=True)
class SgdRecord:
    """What decides whether an artifact of the paper's aligner is current."""

    aligner: Aligner
    smpl: Path | None
    dyna: tuple[Path, ...]
    validation: tuple[str, ...]
    steps: int
    first_frame_steps: int
    shape_steps: int
    lr: float
    momentum: float


@dataclass(frozen=True)
class RobustRecord:
    """What decides whether an artifact of the robust aligner is current."""

    aligner: Aligner
    smpl: Path | None
    dyna: tuple[Path, ...]
    validation: tuple[str, ...]
    robust: RobustSettings


def main(config: AlignConfig) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued.

    Raises
    ------
    DsnetError
        If an input is missing or is not what it should be.
    """
    run = Run(config.run)
    smpl_path, dyna_paths, upstream = _inputs(config, run)
    data = load_body_model(smpl_path)
    with DynaReader(dyna_paths) as reader:
        sequences = _index_of(of_one_gender(reader.entries, data.gender), config.validation)
        for name, record in _records_of(config).items():
            fit = _aligner(config, record.aligner, SMPL(data), reader, sequences)
            made = _Signed(fit, record.aligner)
            run.build(name, record, made, data=data.source, upstream=upstream)


def _records_of(config: AlignConfig) -> dict[str, SgdRecord | RobustRecord]:
    """What the manifests of the artifacts to make, in order, will say of their settings."""
    aligners = _artifacts(config.aligner)
    return {name: _record(config, aligner) for name, aligner in aligners.items()}


def _artifacts(aligner: Literal["sgd", "robust", "both"]) -> dict[str, Aligner]:
    """Artifacts to make, in order, and who makes each."""
    if aligner == "both":
        return {ALIGNMENT: "sgd", ROBUST_ALIGNMENT: "robust"}
    return {ALIGNMENT: aligner}


def _aligner(
    config: AlignConfig,
    aligner: Aligner,
    smpl: SMPL,
    reader: DynaReader,
    sequences: list[MotionSequence],
) -> CorpusFit | RobustCorpusFit:
    if aligner == "robust":
        return RobustCorpusFit(smpl, reader, sequences, config.robust)
    effort = Effort(config.steps, config.first_frame_steps, config.shape_steps)
    return CorpusFit(smpl, reader, sequences, effort, Descent(config.lr, config.momentum))


def _record(config: AlignConfig, aligner: Aligner) -> SgdRecord | RobustRecord:
    """The options that this aligner reads: the other one's do not make its artifact old."""
    kind = RobustRecord if aligner == "robust" else SgdRecord
    named = {field.name for field in fields(kind)} - {"aligner"}
    return kind(aligner=aligner, **{name: getattr(config, name) for name in named})


@dataclass(frozen=True)
class _Signed:
    """An aligner that writes its name into the manifest."""

    fit: CorpusFit | RobustCorpusFit
    aligner: Aligner

    def __call__(self, writer: ArtifactWriter) -> None:
        self.fit.write(writer)
        writer.record(aligner=self.aligner)


def _inputs(
    config: AlignConfig, run: Run
) -> tuple[Path, tuple[Path, ...], Mapping[str, Artifact | Path]]:
    """Body model, mesh files, and what the artifact is made from."""
    if config.smpl is None and not config.dyna:
        corpus = run.artifact("corpus")
        meshes = [name for name in corpus.manifest["files"] if name.endswith(".h5")]
        dyna_files = tuple(corpus.file(name) for name in sorted(meshes))
        return corpus_body_path(corpus), dyna_files, {"corpus": corpus}
    if config.smpl is None or not config.dyna:
        given, missing = ("--dyna", "--smpl") if config.smpl is None else ("--smpl", "--dyna")
        raise DsnetError(
            f"{given} without {missing}",
            "both, or neither for the run's own corpus",
            f"Pass {missing} too.",
        )
    dyna = {f"dyna_{index}": path for index, path in enumerate(config.dyna)}
    return config.smpl, config.dyna, {"smpl": config.smpl, **dyna}


def _index_of(entries: list[DynaEntry], validation: tuple[str, ...]) -> list[MotionSequence]:
    """The index of all sequences in file order."""
    splits = splits_of_names([entry.name for entry in entries], validation)
    sequences, start = [], 0
    for entry in entries:
        split = splits[entry.name]
        sequences.append(
            MotionSequence(entry.name, entry.subject, entry.motion, start, entry.length, FPS, split)
        )
        start += entry.length
    return sequences
