"""`dsnet predict`: one motion to the files of a moving body; no framework, no training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bridge.errors import DsnetError
from bridge.runs import Run
from bridge.runtime.controls import Controls


@dataclass(frozen=True)
class PredictConfig(Controls):
    """Predict how the skin of a body moves in one motion, and write offsets and vertices."""

    run: str | None = None
    """Run whose predictor moves the skin; the small model that comes with the package when left
    out, of the motion's gender."""
    predictor: str | None = None
    """Which of the run's; its best when left out: `dsnet_plus` if the run has it."""
    motion: Path | None = None
    """One AMASS `.npz`, a BVH, or `sample:walking`."""
    out: Path | None = None
    """Folder to write: a new or empty one, or that of an earlier prediction."""
    strip: bool = True
    """Whether to draw `strip.png` too, a row of the motion's bodies."""


PROFILES = {name: PredictConfig() for name in ("smoke", "demo", "paper")}


def main(config: PredictConfig) -> None:
    """Write the prediction.

    Raises
    ------
    DsnetError
        If `motion` or `out` is missing, and what `predict_motion` raises.
    """
    if config.motion is None:
        raise DsnetError(
            "predict without --motion",
            "one motion",
            "Pass --motion FILE, or run `dsnet infer` for a run's own sequences.",
        )
    if config.out is None:
        raise DsnetError("--motion without --out", "a folder to write", "Pass --out DIR.")
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
