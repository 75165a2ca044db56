"""`dsnet predict`: the run's own sequences, or with `--motion` one AMASS file to a moving body.

The first form is a stage, made by Keras in a process of its own; the second is made here, without
a framework.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from bridge.errors import DsnetError
from bridge.options import PositiveFloat
from bridge.runs import Run
from bridge.runs.processes import run_module
from bridge.runtime.controls import Controls


@dataclass(frozen=True)
class PredictConfig(Controls):
    """Predict latents for the run's sequences, or a moving body for one AMASS motion.

    What says how a body moves goes with --motion."""

    run: str | None = None
    """Run whose trained predictors predict. With --motion the small model that comes with the
    package when left out, of the motion's gender; without, the run named as the profile."""
    predictor: str | None = None
    """Which of them. With --motion the run's best when left out: `dsnet_plus` if the run has it;
    without, the network that the report shows first."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs to predict beside the run's sequences (those of the run's own
    corpus when left out). What is no motion, or of the other gender, is left out and counted."""
    amass_fps: PositiveFloat | None = None
    """Frames per second of these files, where what they say of themselves is wrong."""
    motion: Path | None = None
    """One AMASS `.npz` or a BVH; with it, vertices are written to --out."""
    out: Path | None = None
    """Folder to write for --motion: a new or empty one, or that of an earlier prediction."""
    strip: bool = True
    """Whether --motion also draws `strip.png`, a row of its bodies."""
    profile: tyro.conf.Suppress[str] = "demo"
    """Whose run it is when none is named."""


PROFILES = {name: PredictConfig(profile=name) for name in ("smoke", "demo", "paper")}


def main(config: PredictConfig) -> None:
    """Run the stage, or the single-motion form when `motion` is given.

    Raises
    ------
    DsnetError
        If options do not go together, and what `predict_motion` raises.
    """
    _check_together(config)
    if config.motion is None or config.out is None:
        _run_stage(config)
        return
    from bridge.runtime.predict_motion import predict_motion

    run = None if config.run is None else Run(config.run)
    predict_motion(
        run,
        config.motion,
        config.out,
        predictor=config.predictor,
        controls=config,
        strip=config.strip,
    )


def _check_together(config: PredictConfig) -> None:
    if config.motion is None:
        for name in (*(["out"] if config.out else []), *config.given()):
            flag = f"--{name.replace('_', '-')}"
            raise DsnetError(
                f"{flag} without --motion", f"{flag} with one motion", "Pass --motion FILE."
            )
    elif config.out is None:
        raise DsnetError("--motion without --out", "a folder to write", "Pass --out DIR.")
    elif config.amass is not None:
        raise DsnetError(
            "--amass with --motion", "a folder of motions, or one motion", "Leave one of them out."
        )
    elif config.amass_fps is not None:
        raise DsnetError(
            "--amass-fps with --motion", "the rate of a folder's files", "Pass --motion-fps."
        )


def _run_stage(config: PredictConfig) -> None:
    options = {
        "--run": config.run or config.profile,
        "--predictor": config.predictor,
        "--amass": config.amass,
        "--amass-fps": config.amass_fps,
    }
    given = [text for key, value in options.items() if value for text in (key, str(value))]
    run_module("tf_dsnet.stage_predict", *given)
