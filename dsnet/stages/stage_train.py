"""Stage `train`: networks learn latents from motions (Section 5, "Training process"); with them
`dsnet_plus` learns offsets."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm
from tyro.conf import Fixed

from bridge.body import load_paper_body
from bridge.errors import DsnetError, notify
from bridge.exchange import save_weights
from bridge.exchange.dsnet import DSNETS, CodeName, load_unpadded_clips
from bridge.options import PositiveInt
from bridge.plugins import entry_named
from bridge.runs import ArtifactWriter, Run
from bridge.runs.run import ALIGNMENT, TRAIN, best_alignment_of, body_model_path
from bridge.runs.workers import worker_pool
from bridge.tissue.trained_plus import NAME as PLUS
from dsnet.fitting.train import train_on_markers
from tf_dsnet import stage_train_plus
from tf_dsnet.predictors import (
    Predictor,
    PredictorSettings,
    PredictorTraining,
    TrainingData,
    predictors_named,
    registered_predictors,
)
from tf_dsnet.stage_train_plus import TrainPlusConfig


@dataclass(frozen=True)
class NetworksRecord(PredictorSettings):
    """What decides whether an artifact of the networks is current."""

    predictors: tuple[str, ...] = ()
    """Which predictors to train; all of the product that the run can when left out, with one line
    about those that it cannot. `dsnet_faithful`: raw inputs and latents. `dsnet_standardised`: both
    scaled, a departure from the silent paper. `dsnet_plus`: oscillators on the skin, of the robust
    aligner's offsets. Others are those of the modules that DSNET_PLUGINS names. The first network
    is the one that `report` shows."""
    validate_every: Fixed[PositiveInt] = 10
    """Epochs between two validation losses."""
    checkpoint_every: Fixed[PositiveInt] = 100
    """Epochs between two checkpoints."""


@dataclass(frozen=True)
class TrainConfig(NetworksRecord):
    """Train predictors on the training sequences.

    Costs some 60 ms an epoch of both networks for 40 sequences of 300 frames on two cores, 1 GB,
    and two minutes for `dsnet_plus`. Gives weights and losses: `train` those of the networks,
    `train_plus` those of `dsnet_plus`. The weights of the last epoch are kept: choosing the epoch
    that suits the validation sequence best would make its error a training error.
    """

    run: str = "demo"
    """Name of the run whose latents or offsets are learned."""
    markers: Path | None = None
    """Folder of motions of people who wore skin markers, for `train_markers` alone: constants of
    `dsnet_plus`, the run's or else the package's, by frequency, damping and preload of their flesh.
    About a minute a person."""
    rounds: PositiveInt = 8
    """Rounds of `dsnet_plus`; each begins with a simulation of every clip."""
    plus: Fixed[TrainPlusConfig] = field(default_factory=TrainPlusConfig)
    """How else `dsnet_plus` is trained."""


PROFILES: dict[str, TrainConfig] = {
    "smoke": TrainConfig(
        run="smoke", epochs=20, rounds=4, plus=TrainPlusConfig(steps=8, nodes=300)
    ),
    "demo": TrainConfig(run="demo"),
    "paper": TrainConfig(run="paper", epochs=5000, checkpoint_every=250, rounds=24),
}


def main(config: TrainConfig) -> None:
    run = Run(config.run)
    if config.markers:
        if config.predictors:
            raise DsnetError(
                "--predictors with --markers",
                "one of them: markers give constants of dsnet_plus",
                "Leave one out.",
            )
        train_on_markers(run, config.markers)
        return
    names = config.predictors or _trainable(run)
    networks = [name for name in names if name != PLUS]
    for name in names:
        entry_named(name, "predictor", {**registered_predictors(), PLUS: None})
    if networks:
        own: dict[str, Any] = {f.name: getattr(config, f.name) for f in fields(NetworksRecord)}
        record = replace(NetworksRecord(**own), predictors=tuple(networks))
        _build_networks(run, record, predictors_named(networks))
    if PLUS in names:
        stage_train_plus.main(plus_config(config))


def plus_config(config: TrainConfig) -> TrainPlusConfig:
    return replace(config.plus, run=config.run, seed=config.seed, rounds=config.rounds)


def _trainable(run: Run) -> list[str]:
    """The product's predictors that the run can train; a pipeline that it began is not left out."""
    if run.finished(ALIGNMENT):
        run.artifact("encode")
    if run.finished("encode") and best_alignment_of(run):
        return [*DSNETS, PLUS]
    if best_alignment_of(run):
        notify(f"left out: {', '.join(DSNETS)}, which needs 'encode'")
        return [PLUS]
    run.artifact("encode")  # says what to run
    notify(f"left out: {PLUS}, which needs an alignment by the robust aligner")
    return [*DSNETS]


def _build_networks(run: Run, config: NetworksRecord, chosen: list[Predictor]) -> None:
    encoded = run.artifact("encode")
    body = cache(lambda: load_paper_body(str(body_model_path(run))))

    @cache
    def clips_of(code: CodeName) -> TrainingData:
        train, validation = (
            load_unpadded_clips(encoded, split, code) for split in ("train", "validation")
        )
        return TrainingData(train, validation, body)

    def make(writer: ArtifactWriter) -> None:
        trainings = {
            entry.name: entry.training(
                config, clips_of(entry.code), writer.checkpoints / f"{entry.name}.safetensors"
            )
            for entry in chosen
        }
        epoch_s = _train(trainings, config)
        writer.record_measured(**{f"epoch_s_{name}": round(s, 4) for name, s in epoch_s.items()})
        described = {
            entry.name: _store(entry, trainings[entry.name], config, writer) for entry in chosen
        }
        last = config.epochs
        epochs = [e + 1 for e in range(last) if _due(e, config.validate_every, last)]
        writer.put("validation_epochs", np.array(epochs, np.int32), "epoch")
        shown = chosen[0].name
        writer.record(
            default=shown,
            predictors=described,
            # Of the one that is shown: networks of other inputs have other numbers of parameters.
            parameters=trainings[shown].parameters(),
        )

    run.build(TRAIN, config, make, data=encoded.origin, upstream={"encode": encoded})


def _train(
    trainings: Mapping[str, PredictorTraining], config: NetworksRecord
) -> Mapping[str, float]:
    """Predictors side by side, epoch by epoch: one alone leaves half of two cores idle. Gives mean
    seconds of the epochs of each; nothing where all were behind its checkpoint."""
    seconds: dict[str, list[float]] = defaultdict(list)
    first = min(len(training.losses) for training in trainings.values())
    # disable=None: quiet when the output is not a terminal.
    epochs = tqdm(range(first, config.epochs), desc=" and ".join(trainings), total=config.epochs,
                  initial=first, unit="epoch", disable=None, mininterval=0.5)  # fmt: skip
    with worker_pool("threads", None, len(trainings)) as pool:
        for epoch in epochs:
            validate = _due(epoch, config.validate_every, config.epochs)

            def advance(_: None, name: str) -> None:
                training, started = trainings[name], time.perf_counter()
                is_new = len(training.losses) == epoch  # noqa: B023
                training.epoch(epoch, validate=validate)  # noqa: B023
                if is_new:
                    seconds[name].append(time.perf_counter() - started)

            list(pool.map(advance, trainings))  # raises what a thread raised
            if validate:
                epochs.set_postfix({n: t.validation_losses[-1] for n, t in trainings.items()})
            if _due(epoch, config.checkpoint_every, config.epochs):
                for training in trainings.values():
                    training.save()
    return {name: float(np.mean(each)) for name, each in seconds.items()}


def _due(epoch: int, every: int, epochs: int) -> bool:
    """Whether something done every so many epochs, and at the end, is due after this epoch."""
    return (epoch + 1) % every == 0 or epoch + 1 == epochs


def _store(
    entry: Predictor, training: PredictorTraining, config: NetworksRecord, writer: ArtifactWriter
) -> dict[str, Any]:
    """Write what was learned; gives what the manifest says of the predictor."""
    name, unit = entry.name, "latent unit, summed over frames"
    save_weights(writer.file_path(f"{name}.safetensors"), training.arrays())
    writer.put(f"loss_{name}", np.array(training.losses, np.float32), unit)
    validation = np.array(training.validation_losses, np.float32)
    writer.put(f"validation_loss_{name}", validation, unit)
    return {
        "label": entry.label,
        "lr": training.lr,
        "parameters": next(iter(training.parameters().values())),
        "code": entry.code,
        "departures": list(entry.departures(config)),
    }
