"""Latents of one motion: the Keras part of `dsnet predict --motion`, a process of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bridge.exchange.dsnet_presets import PresetName, load_trained_dsnet
from bridge.runs import Artifact, Run, read_artifact, write_artifact
from bridge.runs.processes import run_as_process
from tf_dsnet.stage_predict import ClipPredictor


@dataclass(frozen=True)
class PredictMotionConfig:
    """Predict the latents of one motion that is already at 60 fps with y up."""

    run: str
    """Name of the run whose trained network predicts."""
    motion: Path
    """Artifact of kind `motion`: `theta` (T, 69), `betas` (10,)."""
    out: Path
    """Artifact of kind `prediction` to write: `latents` (T, 100)."""
    reading: PresetName | None = None
    """Which trained DSNet predicts; the run's own choice when left out."""


def main(config: PredictMotionConfig) -> Artifact:
    """Predict and write.

    Raises
    ------
    DsnetError
        If the run has no finished `train`, or the motion is no such artifact.
    """
    trained = Run(config.run).artifact("train")
    motion = read_artifact(config.motion, "motion")
    reading = load_trained_dsnet(trained, config.reading)
    latents = ClipPredictor(reading)(motion.array("theta"), motion.array("betas"))
    return write_artifact(
        config.out,
        "prediction",
        {"latents": latents},
        units={"latents": "latent unit"},
        data=trained.origin,
        upstream={"train": trained.content_sha256, "motion": motion.content_sha256},
        reading=reading.name,
        fps=motion.manifest.get("fps"),
    )


if __name__ == "__main__":
    run_as_process(PredictMotionConfig, main)
