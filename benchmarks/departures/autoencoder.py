"""`python -m benchmarks.departures.autoencoder`: the autoencoder of one step, and its codes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

from benchmarks.departures.ladder import AUTOENCODERS
from benchmarks.processes import run_as_process
from torch_align_ae.autoencoder import stage_encode, stage_train_ae
from torch_align_ae.autoencoder.stage_train_ae import PRESETS, TrainingPreset


@dataclass(frozen=True)
class AutoencoderConfig:
    """Train the autoencoder of a step in float32 on 70 % of all meshes, and encode all."""

    run: str
    """Run whose `align` is learned."""
    step: str
    """Name of the step."""
    steps: int
    """Steps of the training."""
    seed: int = 0


def main(config: AutoencoderConfig) -> None:
    (step,) = (one for one in AUTOENCODERS if one.name == config.step)
    presets = cast("dict[str, TrainingPreset]", PRESETS)
    presets[step.name] = TrainingPreset(
        step.normalisation,
        step.initialisation,
        warmup_steps=20 if step.rate_varies else 0,
        cosine_decay=step.rate_varies,
        departures=() if step.name.startswith("literal") else (step.text,),
    )
    preset: Any = step.name
    stage_train_ae.main(
        stage_train_ae.TrainAutoencoderConfig(
            run=config.run,
            seed=config.seed,
            preset=preset,
            steps=config.steps,
            precision="float32",
            include_held_out=True,
            validate_every=25,
            validation_frames=256,
            patience=0,
            literal_steps=0,
        )
    )
    stage_encode.main(stage_encode.EncodeConfig(run=config.run))


if __name__ == "__main__":
    run_as_process(AutoencoderConfig, main)
