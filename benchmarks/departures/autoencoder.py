"""`python -m benchmarks.departures.autoencoder`: train the autoencoder of a code, and encode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

from benchmarks.departures.ladder import CODES
from benchmarks.processes import run_as_process
from torch_align_ae.autoencoder import stage_encode, stage_train_ae
from torch_align_ae.autoencoder.stage_train_ae import PRESETS, TrainingPreset


@dataclass(frozen=True)
class AutoencoderConfig:
    """Train it in float32 on 70 % of all meshes, as the paper does."""

    run: str
    """Run whose `align` is learned."""
    code: str
    """Which code of the ladder."""
    steps: int
    """Steps of the training."""
    seed: int = 0


def main(config: AutoencoderConfig) -> None:
    code = CODES[config.code]
    preset = TrainingPreset(
        "standard",
        code.initialisation,
        warmup_steps=20 if code.rate_varies else 0,
        cosine_decay=code.rate_varies,
        departures=(),
    )
    cast("dict[str, TrainingPreset]", PRESETS)[config.code] = preset
    name: Any = config.code
    stage_train_ae.main(
        stage_train_ae.TrainAutoencoderConfig(
            run=config.run,
            seed=config.seed,
            preset=name,
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
