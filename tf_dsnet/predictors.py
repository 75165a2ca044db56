"""What every predictor is, the paper's DSNet as two of them, and the registry of all.

A new predictor is a file with a class as `Predictor` says, and a line: here, or in the function
`predictors()` of a module that `DSNET_PLUGINS` names (`bridge/plugins.py`).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.dsnet import (
    AUTOENCODER,
    DSNETS,
    CodeName,
    Scaling,
    TrainedDsnet,
    UnpaddedClip,
    check_trained,
    fit_scaling,
    join_inputs,
    make_clips,
)
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import INPUT_SIZE
from bridge.plugins import entry_named, with_plugins
from bridge.runs import Artifact
from bridge.runs.files import json_sha256
from tf_dsnet.framework import keras, tf
from tf_dsnet.model import (
    BlockLSTM,
    assign_weights,
    build_dsnet,
    parameter_counts,
    with_own_names,
)
from tf_dsnet.trainer import Build, DsnetTraining, Trainer, described

PAPER_LR = 1e-4
"""Adam's learning rate in Section 5."""
PredictMotion = Callable[[NDArray, NDArray], NDArray]
"""Latents (T, 100) of a motion theta (T, 69) of a body of shape betas (10,)."""
BodyOf = Callable[[], BodyModelData]
"""Gives the run's body model; most predictors never ask."""


@dataclass(frozen=True)
class TrainingData:
    """The run's sequences, each at its own length and in its own units; latents of one code.

    Those of `validation` are only looked at; `theta` moves `body`, and `betas` shape it.
    """

    train: list[UnpaddedClip]
    validation: list[UnpaddedClip]
    body: BodyOf


class PredictorTraining(Protocol):
    """One predictor's training on its way; it may be killed between any two calls.

    `losses` are those of every epoch so far, a checkpoint's from the start; `validation_losses`
    those of every epoch that was validated.
    """

    losses: list[float]
    validation_losses: list[float]

    @property
    def lr(self) -> float:
        """Learning rate, the chosen one where it was searched for; 0 if there is none."""
        ...

    def epoch(self, number: int, *, validate: bool) -> None:
        """Train for epoch `number`, unless the checkpoint was behind it already."""
        ...

    def save(self) -> None: ...  # the checkpoint
    def arrays(self) -> dict[str, NDArray]: ...  # all that `Predictor.load` needs
    def parameters(self) -> dict[str, int]: ...  # how many are learned, by name of the count


class Predictor(Protocol):
    """An entry of the registry; predictors that learn in one go train for one epoch."""

    @property
    def name(self) -> str: ...  # in options, file names and manifests
    @property
    def label(self) -> str: ...  # in tables and legends
    @property
    def code(self) -> CodeName: ...  # which latents it learns

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper, a clause each; empty where it does not."""
        ...

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> PredictorTraining:
        """Begin training, or go on from `checkpoint` if that file is there."""
        ...

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """A trained predictor from what `PredictorTraining.arrays` gave."""
        ...


@dataclass(frozen=True)
class DsnetPredictor:
    """The paper's DSNet, which is silent about the scale of motions and latents.

    Standardised, inputs and latents are scaled, which decides how fast Adam learns. If not, it is
    the paper's words and nothing else: raw motions in, latents as the autoencoder gives them.
    """

    name: str = "dsnet_standardised"
    label: str = "DSNet, standardised"
    standardised: bool = True
    code: CodeName = AUTOENCODER
    build: Build | None = None
    """Gives a network (B, T, `input_size`) to (B, T, L), as `build_dsnet` does, which it is if
    None; it is told `masked` and `lstm_layer` where it has arguments of these names. A chain of the
    layers in `bridge.exchange.layers` also predicts motions, streams and exports."""

    def lr(self, settings: PredictorSettings) -> float:
        return settings.lr_standardised if self.standardised else settings.lr_faithful

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        found = [] if self.build is None else ["the network is not the paper's"]
        if self.standardised:
            found.append("inputs and latents are standardised over the training frames")
        if (lr := self.lr(settings)) != PAPER_LR:
            found.append(f"Adam's learning rate is {lr:g} instead of {PAPER_LR:g}")
        if settings.masked:
            found.append("padded frames are left out of the loss and of the batch normalisation")
        return tuple(found)

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> DsnetTraining:
        scaling = Scaling.identity()
        if self.standardised:
            scaling = fit_scaling(data.train, settings.min_input_std)
        train, validation = (
            make_clips(part, scaling, settings.frames) for part in (data.train, data.validation)
        )
        trainer = Trainer(
            train,
            lr=self.lr(settings),
            batch_size=settings.batch_size,
            masked=settings.masked,
            seed=settings.seed,
            build=self._build_to_train(settings.masked),
        )
        trainer.trace()
        return DsnetTraining(self.name, trainer, scaling, validation, checkpoint)

    def _build_to_train(self, masked: bool) -> Build:
        build = self.build or build_dsnet
        options = {"masked": masked, "lstm_layer": BlockLSTM}  # an LSTM that is quick on a CPU
        known = inspect.signature(build).parameters
        return partial(build, **{n: option for n, option in options.items() if n in known})

    def network_sha256(self, masked: bool) -> str:
        """Digest of the layers and widths of a `build` of one's own; empty for the paper's."""
        if self.build is None:
            return ""
        model = with_own_names(self._build_to_train(masked)(input_size=INPUT_SIZE))
        return json_sha256([described(model), parameter_counts(model)])

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        trained = TrainedDsnet.from_arrays(self.name, arrays)
        latents_of = applied_dsnet(trained, self.build or build_dsnet)
        return lambda theta, betas: latents_of(join_inputs(theta, betas))


def applied_dsnet(
    trained: TrainedDsnet, build: Build = build_dsnet
) -> Callable[[NDArray], NDArray[np.float32]]:
    """A trained DSNet on whole motions: inputs (T, I) in a motion's own units to latents (T, 100).

    It may be told of I numbers other than the 79.
    """
    model = with_own_names(build(input_size=len(trained.scaling.input_mean)))
    assign_weights(model, trained.weights)
    return applied(model, trained.scaling)


def applied(model: keras.Model, scaling: Scaling) -> Callable[[NDArray], NDArray[np.float32]]:
    """A trained network on whole motions: inputs (T, I) to latents (T, D), both in own units."""
    signature = [tf.TensorSpec((None, None, len(scaling.input_mean)), tf.float32)]
    network = tf.function(lambda x: model(x, training=False), input_signature=signature)
    return lambda inputs: scaling.restore(network(scaling.inputs(inputs)[None]).numpy()[0])


def registered_predictors() -> dict[str, Predictor]:
    """Every predictor by name: the paper's network, and what plugins add."""
    faithful = DsnetPredictor("dsnet_faithful", "DSNet, faithful", standardised=False)
    own: tuple[Predictor, ...] = (DsnetPredictor(), faithful)
    return with_plugins("predictors", {entry.name: entry for entry in own})


def predictors_named(names: Iterable[str]) -> list[Predictor]:
    """The entries of these names; refused if there is none, one is unknown, or named twice."""
    names, known = list(names), registered_predictors()
    if not names or len(set(names)) < len(names):
        raise DsnetError(
            f"--predictors {' '.join(names) or '(none)'}",
            f"some of {', '.join(known)}, each once",
            f"Pass --predictors {' '.join(DSNETS)}.",
        )
    return [entry_named(name, "predictor", known) for name in names]


def load_predictor(train: Artifact, name: str, body: BodyOf) -> PredictMotion:
    """One predictor that the run has trained, for motions of `body`; DsnetError if it has not,
    nobody registers it, or its weights are damaged.
    """
    check_trained(train, name)
    (entry,) = predictors_named([name])
    return entry.load(load_weights(train.file(f"{name}.safetensors")), body)
