"""Stage `train`: predictors learn latents from motions (Section 5, "Training process")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from tqdm import tqdm

from bridge.body import load_body_model
from bridge.exchange import save_weights
from bridge.exchange.clips import load_unpadded_clips
from bridge.exchange.codes import CodeName
from bridge.exchange.trained_dsnet import DSNETS
from bridge.options import PositiveInt
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import body_model_path
from bridge.runs.worker_pool import worker_pool
from tf_dsnet.predictors import (
    BodyOf,
    Predictor,
    PredictorSettings,
    PredictorTraining,
    TrainingData,
    predictors_named,
)

STAGE = "train"


@dataclass(frozen=True)
class TrainConfig(PredictorSettings):
    """Train DSNet on the training sequences, once for each predictor that is named.

    Costs some 60 ms an epoch of both for 40 sequences of 300 frames on two cores, 1 GB.
    Gives weights and losses of every predictor. The weights of the last epoch are kept: choosing
    the epoch that suits the validation sequence best would make its error a training error.
    """

    run: str = "demo"
    """Name of the run whose latents are learned."""
    predictors: tuple[str, ...] = DSNETS
    """Which predictors to train; the first is the one that `predict` shows. `dsnet_faithful`: raw
    inputs and latents. `dsnet_standardised`: both scaled, a departure from the silent paper. Others
    are those of the modules that DSNET_PLUGINS names."""
    validate_every: PositiveInt = 10
    """Epochs between two validation losses."""
    checkpoint_every: PositiveInt = 100
    """Epochs between two checkpoints."""


PROFILES: dict[str, TrainConfig] = {
    "smoke": TrainConfig(run="smoke", epochs=20),
    "demo": TrainConfig(run="demo"),
    "paper": TrainConfig(run="paper", epochs=10_000, checkpoint_every=500),
}


def main(config: TrainConfig) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued.

    Raises
    ------
    DsnetError
        If the run has no finished `encode`, a predictor is unknown, or a training diverges.
    """
    chosen = predictors_named(config.predictors)
    run = Run(config.run)
    encoded = run.artifact("encode")
    body = cache(lambda: load_body_model(str(body_model_path(run))))

    def make(writer: ArtifactWriter) -> None:
        clips_of = cache(lambda code: _clips(encoded, code, body))
        trainings = {
            entry.name: entry.training(
                config, clips_of(entry.code), writer.checkpoints / f"{entry.name}.safetensors"
            )
            for entry in chosen
        }
        _train(trainings, config)
        for name, training in trainings.items():
            _store(name, training, writer)
        # Of the one that is shown: networks of other inputs have other numbers of parameters.
        writer.record(parameters=trainings[chosen[0].name].parameters())
        _describe(config, chosen, trainings, writer)
        clips = clips_of(chosen[0].code)
        writer.record(
            sequences_trained_on=len(clips.train), sequences_held_out=len(clips.validation)
        )

    run.build(STAGE, config, make, data=encoded.origin, upstream={"encode": encoded})


def _clips(encoded: Artifact, code: CodeName, body: BodyOf) -> TrainingData:
    train = load_unpadded_clips(encoded, "train", code)
    return TrainingData(train, load_unpadded_clips(encoded, "validation", code), body)


def _train(trainings: Mapping[str, PredictorTraining], config: TrainConfig) -> None:
    """Predictors side by side, epoch by epoch: one alone leaves half of two cores idle."""
    first = min(len(training.losses) for training in trainings.values())
    # disable=None: quiet when the output is not a terminal.
    epochs = tqdm(
        range(first, config.epochs),
        desc=" and ".join(trainings),
        total=config.epochs,
        initial=first,
        unit="epoch",
        disable=None,
        mininterval=0.5,
    )
    with worker_pool("threads", None, len(trainings)) as pool:
        for epoch in epochs:
            validate = _due(epoch, config.validate_every, config.epochs)

            def advance(_: None, training: PredictorTraining) -> None:
                training.epoch(epoch, validate=validate)  # noqa: B023

            list(pool.map(advance, trainings.values()))  # raises what a thread raised
            if validate:
                epochs.set_postfix({n: t.validation_losses[-1] for n, t in trainings.items()})
            if _due(epoch, config.checkpoint_every, config.epochs):
                for training in trainings.values():
                    training.save()


def _due(epoch: int, every: int, epochs: int) -> bool:
    """Whether something done every so many epochs, and at the end, is due after this epoch."""
    return (epoch + 1) % every == 0 or epoch + 1 == epochs


def _store(name: str, training: PredictorTraining, writer: ArtifactWriter) -> None:
    if training.epoch_s is not None:
        writer.record_measured(**{f"epoch_s_{name}": round(training.epoch_s, 4)})
    save_weights(writer.file_path(f"{name}.safetensors"), training.arrays())
    unit = "latent unit, summed over frames"
    writer.put(f"loss_{name}", np.array(training.losses, np.float32), unit)
    validation = np.array(training.validation_losses, np.float32)
    writer.put(f"validation_loss_{name}", validation, unit)


def _describe(
    config: TrainConfig,
    chosen: list[Predictor],
    trainings: Mapping[str, PredictorTraining],
    writer: ArtifactWriter,
) -> None:
    epochs = [e + 1 for e in range(config.epochs) if _due(e, config.validate_every, config.epochs)]
    writer.put("validation_epochs", np.array(epochs, np.int32), "epoch")
    writer.record(
        default=chosen[0].name,
        predictors={
            entry.name: {
                "label": entry.label,
                "lr": trainings[entry.name].lr,
                "parameters": next(iter(trainings[entry.name].parameters().values())),
                "code": entry.code,
                "departures": list(entry.departures(config)),
            }
            for entry in chosen
        },
    )
