"""`dsnet predict`: the run's own sequences, or with `--motion` one AMASS file to a moving body.

The second form is three processes that exchange artifacts: NumPy reads and
resamples the motion, Keras predicts the latents, PyTorch decodes them and
poses the body. It costs about 15 seconds to start the frameworks and 10 ms a
frame, and gives `latents`, `offsets` and `vertices` at 60 fps with y up.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.motion.resampling import Motion, load_amass_motion
from bridge.paper import N_BETAS
from bridge.runs import Run, write_artifact
from bridge.runs.processes import notify, run_module
from bridge.runs.run import body_model_path


@dataclass(frozen=True)
class PredictConfig:
    """Predict latents for the run's sequences, or a moving body for one AMASS motion."""

    run: str = "demo"
    """Run whose trained networks predict."""
    seed: int = 0
    """Recorded; prediction draws no random numbers."""
    reading: Literal["standardised", "faithful"] | None = None
    """Which trained DSNet predicts; the run's own choice when left out."""
    amass: Path | None = None
    """Folder of AMASS files to predict beside the run's sequences (those of the run's own corpus
    when left out). What is no motion, or of the other gender, is left out and counted."""
    motion: Path | None = None
    """One AMASS `.npz`; with it, vertices are written to --out."""
    betas: str | None = None
    """Ten comma-separated shape coefficients in place of the motion file's."""
    out: Path | None = None
    """Folder to write for --motion; it must not exist, be empty, or hold an earlier prediction."""


PROFILES = {name: PredictConfig() for name in ("smoke", "demo", "paper")}


def main(config: PredictConfig) -> None:
    """Run the stage, or the single-motion form when `motion` is given."""
    if config.motion is None:
        from tf_dsnet.stage_predict import PredictStageConfig
        from tf_dsnet.stage_predict import main as predict_run

        predict_run(PredictStageConfig(config.run, config.seed, config.reading, config.amass))
        return
    if config.out is None:
        raise DsnetError("--motion without --out", "a folder to write", "Pass --out DIR.")
    _refuse_foreign_folder(config.out)
    predict_motion(config, config.motion, config.out)


def predict_motion(config: PredictConfig, motion_path: Path, out: Path) -> None:
    """Write `latents`, `offsets`, `vertices`, `manifest.json` and `strip.png` to `out`."""
    run = Run(config.run)
    trained = run.artifact("train")
    motion = _load(run, motion_path, config.betas)
    with tempfile.TemporaryDirectory(prefix="dsnet-") as scratch:
        given, predicted = Path(scratch, "motion"), Path(scratch, "prediction")
        write_artifact(
            given,
            "motion",
            {"theta": motion.theta.astype(np.float32), "betas": motion.betas.astype(np.float32)},
            units={"theta": "rad, then m", "betas": "1"},
            data=trained.origin,
            source=motion_path.name,
            source_fps=motion.source_fps,
            fps=motion.fps,
        )
        arguments = ["--run", config.run, "--motion", str(given), "--out", str(predicted)]
        chosen = ["--reading", config.reading] if config.reading else []
        run_module("tf_dsnet.predict_motion", *arguments, *chosen)
        run_module(
            "torch_align_ae.autoencoder.decode_motion",
            *("--run", config.run, "--motion", str(given)),
            *("--latents", str(predicted), "--out", str(out)),
        )


def _load(run: Run, path: Path, betas: str | None) -> Motion:
    """Read the motion, turned to y up about the root joint of the body that will be posed."""
    motion = load_amass_motion(path)
    if betas is not None:
        motion = replace(motion, betas=_parse_betas(betas))
    body = load_body_model(str(body_model_path(run)))
    if betas is None and {motion.gender, body.gender} == {"female", "male"}:
        notify(f"the betas of {path} are a {motion.gender}'s, the body {body.gender}: see --betas")
    rest = body.v_template + body.shapedirs @ motion.betas
    return motion.about_root_joint((body.J_regressor @ rest)[0])


def _parse_betas(text: str) -> NDArray[np.float64]:
    try:
        betas = np.array([float(part) for part in text.split(",")])
    except ValueError:
        betas = np.empty(0)
    if betas.shape != (N_BETAS,) or not np.isfinite(betas).all():
        raise DsnetError(
            f"--betas {text}", f"{N_BETAS} finite numbers", "Separate them by commas, no spaces."
        )
    return betas


def _refuse_foreign_folder(out: Path) -> None:
    """A finished artifact replaces its folder, so a folder of something else must not be named."""
    if out.exists() and not out.is_dir():
        raise DsnetError(f"--out {out}, a file", "a folder to write", "Name another path.")
    if out.is_dir() and any(out.iterdir()) and not (out / "latents.npy").is_file():
        raise DsnetError(
            f"--out {out}, which holds other files",
            "a new or empty folder, or one of an earlier prediction",
            "Name another folder.",
        )
