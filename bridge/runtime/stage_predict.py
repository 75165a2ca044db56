"""`dsnet predict`: the run's own sequences, or with `--motion` one AMASS file to a moving body.

The first form is a stage, made by Keras in a process of its own; the second is made here, without
a framework.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.paper import N_BETAS
from bridge.runs import Run
from bridge.runs.processes import run_module


@dataclass(frozen=True)
class PredictConfig:
    """Predict latents for the run's sequences, or a moving body for one AMASS motion."""

    run: str | None = None
    """Run whose trained predictors predict. With --motion the small model that comes with the
    package when left out, of the motion's gender; without, the run named as the profile."""
    predictor: str | None = None
    """Which of them. With --motion the run's best when left out: `dsnet_plus` if the run has it;
    without, the network that the report shows first."""
    amass: Path | None = None
    """Folder of AMASS files to predict beside the run's sequences (those of the run's own corpus
    when left out). What is no motion, or of the other gender, is left out and counted."""
    motion: Path | None = None
    """One AMASS `.npz`; with it, vertices are written to --out."""
    betas: str | None = None
    """Ten comma-separated shape coefficients in place of the motion file's."""
    out: Path | None = None
    """Folder to write for --motion: a new or empty one, or that of an earlier prediction."""
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

    betas = None if config.betas is None else parse_betas(config.betas)
    run = None if config.run is None else Run(config.run)
    predict_motion(run, config.motion, config.out, predictor=config.predictor, betas=betas)


def _check_together(config: PredictConfig) -> None:
    if config.motion is None:
        for name in ("out", "betas"):
            if getattr(config, name) is not None:
                raise DsnetError(
                    f"--{name} without --motion", f"--{name} with one motion", "Pass --motion FILE."
                )
    elif config.out is None:
        raise DsnetError("--motion without --out", "a folder to write", "Pass --out DIR.")
    elif config.amass is not None:
        raise DsnetError(
            "--amass with --motion", "a folder of motions, or one motion", "Leave one of them out."
        )


def _run_stage(config: PredictConfig) -> None:
    options = {
        "--run": config.run or config.profile,
        "--predictor": config.predictor,
        "--amass": config.amass,
    }
    given = [text for key, value in options.items() if value for text in (key, str(value))]
    run_module("tf_dsnet.stage_predict", *given)


def parse_betas(text: str) -> NDArray[np.float64]:
    """The ten numbers of `--betas a,b,...`.

    Raises
    ------
    DsnetError
        If they are other than ten finite numbers.
    """
    try:
        betas = np.array([float(part) for part in text.split(",")])
    except ValueError:
        betas = np.empty(0)
    if betas.shape != (N_BETAS,) or not np.isfinite(betas).all():
        raise DsnetError(
            f"--betas {text}", f"{N_BETAS} finite numbers", "Separate them by commas, no spaces."
        )
    return betas
