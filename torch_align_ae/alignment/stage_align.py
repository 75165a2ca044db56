"""Stage `align`: from registered meshes to shapes, poses and dynamic offsets (Section 3.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Literal

from tyro.conf import Fixed

from bridge.body import load_paper_body
from bridge.errors import DsnetError, notify, unknown_name
from bridge.meshes.dyna_files import DynaSequence, dyna_sequences, of_one_gender
from bridge.motion import MotionSequence
from bridge.motion.sequences import end_to_end
from bridge.motion.splits import splits_of_names
from bridge.paper import FPS
from bridge.runs import Artifact, Run
from bridge.runs.run import ALIGNMENT, ROBUST_ALIGNMENT, corpus_body_path
from torch_align_ae.alignment.robust import RobustFit, RobustSettings
from torch_align_ae.alignment.sgd import Descent, SgdFit
from torch_align_ae.body import SMPL


@dataclass(frozen=True)
class AlignConfig(Descent):
    """Align SMPL to every mesh and unpose the offsets (Section 3.3, Eq. 5).

    SGD takes 0.4 to 0.9 ms of one core per frame and step; memory does not grow with the
    corpus. Gives `betas`, `theta`, `offsets` and `frame_error`. Steps, rate and momentum are SGD's.
    """

    run: str = "demo"
    """Run to write; its corpus is aligned unless --smpl and --dyna are given."""
    smpl: Path | None = None
    """SMPL model file (.npz or .pkl), given together with --dyna."""
    dyna: tuple[Path, ...] = ()
    """Dyna or D-FAUST HDF5 files, given together with --smpl."""
    aligner: Literal["sgd", "robust", "both"] = "both"
    """`sgd` is the paper's; `robust` keeps the soft tissue's motion out of pose and shape; `both`
    writes `align` by the first and `align_robust` by the second."""
    robust: Fixed[RobustSettings] = field(default_factory=RobustSettings)
    """Settings of `robust`."""
    validation: tuple[str, ...] = ("50004_one_leg_jump", "50002_one_leg_jump")
    """Sequences held out from training; the last one if the files have none of these."""
    leave_out: tuple[str, ...] = ()
    """Sequences that are not aligned, such as those with a scan that failed."""


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


def main(config: AlignConfig) -> None:
    run = Run(config.run)
    smpl_path, dyna_paths, upstream = _inputs(config, run)
    data = load_paper_body(smpl_path)
    artifacts = {ALIGNMENT: "sgd", ROBUST_ALIGNMENT: "robust"}
    if config.aligner != "both":
        artifacts = {ALIGNMENT: config.aligner}
    mesh_sequences = of_one_gender(dyna_sequences(dyna_paths), data.gender)
    mesh_sequences = _without(mesh_sequences, config.leave_out)
    meshes = {one.name: one for one in mesh_sequences}
    splits = splits_of_names(list(meshes), config.validation)
    described = [
        MotionSequence(one.name, one.subject, one.motion, 0, one.length, FPS, splits[one.name])
        for one in mesh_sequences
    ]
    sequences, smpl = end_to_end(described), SMPL(data)
    for name, aligner in artifacts.items():
        if aligner == "sgd":
            unused, fit = ["robust"], SgdFit(smpl, sequences, meshes, config)
        else:
            unused = [one.name for one in fields(Descent)]
            fit = RobustFit(smpl, sequences, meshes, config.robust)
        # Without options of the other aligner, whose change does not make this artifact outdated.
        options = {key: value for key, value in asdict(config).items() if key not in unused}
        options["aligner"] = aligner
        # As before there were such options: what is done stays current.
        for key in ("leave_out", "iterate", "betas_per", "stock"):
            if options.get(key) == getattr(AlignConfig, key):
                del options[key]
        run.build(name, options, fit.write, data=data.source, upstream=upstream)


def _without(sequences: list[DynaSequence], names: Sequence[str]) -> list[DynaSequence]:
    """The sequences but for those named, which a line on stderr counts."""
    there = [one.name for one in sequences]
    for name in names:
        if name not in there:
            raise unknown_name(f"--leave-out {name}", name, there, "Name one of these.")
    kept = [one for one in sequences if one.name not in names]
    if not kept:
        raise DsnetError(
            "--leave-out of all sequences", "one to align at least", "Name fewer of them."
        )
    if names:
        notify(f"{len({*names})} of {len(there)} sequences left out, as asked")
    return kept


def _inputs(
    config: AlignConfig, run: Run
) -> tuple[Path, tuple[Path, ...], Mapping[str, Artifact | Path]]:
    """Body model, mesh files, and upstream artifacts and files."""
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
