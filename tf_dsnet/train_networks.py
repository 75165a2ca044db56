"""Training of networks: they learn latents from motions (Section 5, "Training process")."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import load_paper_body
from bridge.errors import notify
from bridge.exchange import save_weights
from bridge.exchange.dsnet import CodeName, load_unpadded_clips
from bridge.exchange.train_options import NetworksRecord
from bridge.runs import ArtifactWriter, Run
from bridge.runs.run import TRAIN, body_model_path
from bridge.runs.workers import worker_pool
from tf_dsnet.kept_networks import plan_networks
from tf_dsnet.keras_files import save_keras
from tf_dsnet.predictors import (
    DsnetPredictor,
    Predictor,
    PredictorTraining,
    TrainingData,
    predictors_named,
)
from tf_dsnet.tensorboard import LossCurves
from tf_dsnet.trainer import DsnetTraining

TENSORBOARD = "tensorboard"
"""Folder of a run, beside its artifacts and part of none."""


def train_networks(run: Run, config: NetworksRecord, *, tensorboard: bool = False) -> None:
    """Make `train`: the networks that the configuration names learn latents, others stay.

    With `tensorboard`, losses are also written epoch by epoch, for TensorBoard.
    """
    chosen = predictors_named(config.predictors)
    encoded = run.artifact("encode")
    plan = plan_networks(run, encoded, config, chosen)
    body = cache(lambda: load_paper_body(str(body_model_path(run))))

    @cache
    def clips_of(code: CodeName) -> TrainingData:
        train, validation = (
            load_unpadded_clips(encoded, split, code) for split in ("train", "validation")
        )
        return TrainingData(train, validation, body)

    def make(writer: ArtifactWriter) -> None:
        described = plan.copy_kept(run, writer)
        trainings = {
            entry.name: entry.training(
                config, clips_of(entry.code), writer.checkpoints / f"{entry.name}.safetensors"
            )
            for entry in plan.new
        }
        curves = LossCurves(run.path / TENSORBOARD) if tensorboard else None
        epoch_s = _train(trainings, config, curves) if trainings else {}
        writer.record_measured(**{f"epoch_s_{name}": round(s, 4) for name, s in epoch_s.items()})
        for entry in plan.new:
            described[entry.name] = _store(entry, trainings[entry.name], config, writer)
        default = plan.names[0]
        writer.record(
            default=default,
            predictors={name: described[name] for name in plan.names},
            # Of the default: networks of other inputs have other numbers of parameters.
            parameters=described[default]["counts"],
        )

    run.build(TRAIN, plan.config, make, data=encoded.origin, upstream={"encode": encoded})


def _train(
    trainings: Mapping[str, PredictorTraining], config: NetworksRecord, curves: LossCurves | None
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
            row = epoch // config.validate_every
            losses = {n: t.losses[epoch] for n, t in trainings.items()}
            validated = {n: t.validation_losses[row] for n, t in trainings.items() if validate}
            if validate:
                epochs.set_postfix(validated)
            if curves:
                curves.add("train", losses, epoch)
                curves.add("validation", validated, epoch)
            if _due(epoch, config.checkpoint_every, config.epochs):
                for training in trainings.values():
                    training.save()
    return {name: float(np.mean(each)) for name, each in seconds.items()}


def _due(epoch: int, every: int, epochs: int) -> bool:
    """Whether something done every so many epochs, and at the end, is due after this epoch."""
    return (epoch + 1) % every == 0 or epoch + 1 == epochs


def _save_for_keras(
    entry: DsnetPredictor, arrays: Mapping[str, NDArray], writer: ArtifactWriter
) -> None:
    """Write a `.keras` file of the network, with a note where its own layers cannot be saved."""
    file = f"{entry.name}.keras"
    saved = writer.checkpoints / file
    try:
        save_keras(entry.network(arrays), saved)
    except (NotImplementedError, TypeError, ValueError) as reason:
        notify(f"no {file}, as Keras cannot save the network: {str(reason).strip():.120}")
    else:
        saved.replace(writer.file_path(file))


def _store(
    entry: Predictor, training: PredictorTraining, config: NetworksRecord, writer: ArtifactWriter
) -> dict[str, Any]:
    """Write what was learned; gives what the manifest says of the predictor."""
    name, unit = entry.name, "latent unit, summed over frames"
    arrays = training.arrays()
    save_weights(writer.file_path(f"{name}.safetensors"), arrays)
    if isinstance(entry, DsnetPredictor):
        _save_for_keras(entry, arrays, writer)
    writer.put(f"loss_{name}", np.array(training.losses, np.float32), unit)
    validation = np.array(training.validation_losses, np.float32)
    writer.put(f"validation_loss_{name}", validation, unit)
    last = config.epochs
    epochs = [e + 1 for e in range(last) if _due(e, config.validate_every, last)]
    writer.put(f"validation_epochs_{name}", np.array(epochs, np.int32), "epoch")
    return {
        "label": entry.label,
        "lr": training.lr,
        "parameters": next(iter(training.parameters().values())),
        "counts": training.parameters(),
        "code": entry.code,
        "departures": list(entry.departures(config)),
        **(training.described() if isinstance(training, DsnetTraining) else {}),
    }
