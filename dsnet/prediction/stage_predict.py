"""`dsnet predict`: motions to the files of moving bodies; no framework, no training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bridge.errors import DsnetError, did_you_mean
from dsnet.prediction.controls import Controls
from dsnet.prediction.predict_folder import predict_folder
from dsnet.prediction.prediction_files import OF_MANY, OF_ONE, WRITABLE, predict_motion


@dataclass(frozen=True)
class PredictConfig(Controls):
    """Predict how the skin of a body moves in one motion, or in all of a folder, and write it."""

    run: str | None = None
    """Run whose predictor moves the skin, or a folder that `save` wrote; the small model that comes
    with the package when left out, of the motion's gender."""
    predictor: str | None = None
    """Which of the run's; its best when left out: `dsnet_plus` if the run has it."""
    motion: Path | None = None
    """One motion: AMASS `.npz`, BVH and others (docs/motion_files.md), or `sample:walking`. Or a
    folder: every motion below it, which is not yet done (docs/motion_files.md)."""
    out: Path | None = None
    """Folder to write: a new or empty one, or that of an earlier prediction. For a folder of
    motions, the one whose tree will be the same."""
    write: tuple[str, ...] = ()
    """Of offsets, vertices, latents and strip (a picture), or offsets16, half as large: by default
    all of one motion, of a folder's the offsets."""


PROFILES = {name: PredictConfig() for name in ("smoke", "demo", "paper")}


def main(config: PredictConfig) -> None:
    """Write the prediction, or those of a folder."""
    if config.motion is None:
        raise DsnetError(
            "predict without --motion",
            "one motion, or a folder of them",
            "Pass --motion FILE, or run `dsnet infer` for a run's own sequences.",
        )
    if config.out is None:
        raise DsnetError("--motion without --out", "a folder to write", "Pass --out DIR.")
    write = what_to_write(config.write, config.motion)
    predict = predict_folder if config.motion.is_dir() else predict_motion
    predict(
        config.run,
        config.motion,
        config.out,
        predictor=config.predictor,
        controls=config,
        write=write,
    )


def what_to_write(asked: Sequence[str], motion: Path) -> tuple[str, ...]:
    """The words of `--write`, each of `WRITABLE`, in that order; by default what is usual."""
    otherwise = OF_MANY if motion.is_dir() else OF_ONE
    words = [word for text in asked for word in text.replace(",", " ").split()]
    if unknown := [word for word in words if word not in WRITABLE]:
        remedy = did_you_mean(unknown[0], WRITABLE, "Pass --write offsets,vertices.")
        raise DsnetError(f"--write {unknown[0]}", f"of {', '.join(WRITABLE)}", remedy)
    if {"offsets", "offsets16"} <= {*words}:
        raise DsnetError("--write offsets,offsets16", "one of both", "Leave one out.")
    if "strip" in words and not ("vertices" in words and {"offsets", "offsets16"} & {*words}):
        remedy = "Pass --write offsets,vertices,strip."
        raise DsnetError("--write strip", "it with offsets and vertices, which it shows", remedy)
    return tuple(word for word in WRITABLE if word in (words or otherwise))
