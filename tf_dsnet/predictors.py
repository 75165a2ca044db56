"""The interface of predictors, the paper's DSNet as two of them, and the registry of all.

To add a predictor, write a class with the methods of `Predictor`, and register it here or in the
function `predictors()` of a module that `DSNET_PLUGINS` names (`bridge/plugins.py`).
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.dsnet import (
    AUTOENCODER,
    DSNETS,
    LITERAL_DSNETS,
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
from tf_dsnet.keras_files import stock_network
from tf_dsnet.model import LSTM_LAYERS, assign_weights, build_dsnet, with_own_names
from tf_dsnet.trainer import Build, DsnetTraining, Trainer

PAPER_LR = 1e-4
"""Adam's learning rate in Section 5."""
PredictMotion = Callable[[NDArray, NDArray], NDArray]
"""Latents (T, 100) of a motion theta (T, 69) of a body of shape betas (10,)."""
BodyOf = Callable[[], BodyModelData]
"""Loads the run's body model, which most predictors do not need."""


@dataclass(frozen=True)
class TrainingData:
    """The run's sequences, neither padded nor scaled, with latents of one code.

    `validation` is for validation losses alone; `theta` and `betas` are of `body`.
    """

    train: list[UnpaddedClip]
    validation: list[UnpaddedClip]
    body: BodyOf


class PredictorTraining(Protocol):
    """The training of one predictor, epoch by epoch; the process may be killed at any time.

    `losses` are of every epoch so far, those before a checkpoint included; `validation_losses` are
    of every validated epoch.
    """

    losses: list[float]
    validation_losses: list[float]

    @property
    def lr(self) -> float:
        """The learning rate, the best one if several were tried; 0 if there is none."""
        ...

    def epoch(self, number: int, *, validate: bool) -> None:
        """Train epoch `number`, unless the checkpoint already contains it."""
        ...

    def save(self) -> None: ...  # the checkpoint
    def arrays(self) -> dict[str, NDArray]: ...  # what `Predictor.load` takes
    def parameters(self) -> dict[str, int]: ...  # numbers of learned parameters, by name


class Predictor(Protocol):
    """An entry of the registry; a predictor without epochs is trained in the first one."""

    @property
    def name(self) -> str: ...  # in options, file names and manifests
    @property
    def label(self) -> str: ...  # in tables and legends
    @property
    def code(self) -> CodeName: ...  # which latents it learns

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Its departures from the paper, a clause each; empty if there are none."""
        ...

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> PredictorTraining:
        """Start training, or continue from `checkpoint` if that file exists."""
        ...

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """The trained predictor from the arrays of `PredictorTraining.arrays`."""
        ...


@dataclass(frozen=True)
class DsnetPredictor:
    """The paper's DSNet, with or without standardised inputs and latents.

    The paper does not say how motions and latents are scaled, which decides how fast Adam learns.
    If not `standardised`, both are used as they are.
    """

    name: str = "dsnet_standardised"
    label: str = "DSNet, standardised"
    standardised: bool = True
    code: CodeName = AUTOENCODER
    build: Build | None = None
    """Builds a network (B, T, `input_size`) to (B, T, L); `build_dsnet` if None. It is given
    `masked` and `lstm_layer` if it has parameters of these names. Only chains of the layers in
    `bridge.exchange.layers` can predict new motions, stream and be exported."""

    def lr(self, settings: PredictorSettings) -> float:
        return settings.lr_standardised if self.standardised else settings.lr_faithful

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        departures = [] if self.build is None else ["the network is not the paper's"]
        if self.standardised:
            departures.append("inputs and latents are standardised over the training frames")
        if (lr := self.lr(settings)) != PAPER_LR:
            departures.append(f"Adam's learning rate is {lr:g} instead of {PAPER_LR:g}")
        if settings.masked:
            departures.append(
                "padded frames are left out of the loss and of the batch normalisation"
            )
        return tuple(departures)

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
            build=self._build_to_train(settings),
        )
        trainer.trace()
        return DsnetTraining(self.name, trainer, scaling, validation, checkpoint)

    def _build_to_train(self, settings: PredictorSettings) -> Build:
        build = self.build or build_dsnet
        options = {"masked": settings.masked, "lstm_layer": LSTM_LAYERS[settings.lstm]}
        accepted = inspect.signature(build).parameters
        return partial(build, **{n: option for n, option in options.items() if n in accepted})

    def network_sha256(self, settings: PredictorSettings) -> str:
        """Digest of the layers' options of a `build` of one's own; empty for the paper's.

        DsnetError if a layer does not tell its options: then Keras cannot save it either.
        """
        if self.build is None:
            return ""
        model = self._build_to_train(settings)(input_size=INPUT_SIZE)
        try:
            layers = [
                [type(one).__name__, _without_names(one.get_config())] for one in model.layers
            ]
        except NotImplementedError as error:
            raise DsnetError(
                f"{self.name}, a layer of which does not tell its options",
                "layers whose `get_config` gives what they were made with",
                "Write the method, as keras.layers.Layer.get_config says.",
            ) from error
        return json_sha256(json.loads(json.dumps(layers, default=str)))

    def network(self, arrays: Mapping[str, NDArray]) -> keras.Model:
        """The trained network (B, T, 79) -> (B, T, 100) of Keras's own layers, from the arrays of
        `PredictorTraining.arrays`."""
        trained = TrainedDsnet.from_arrays(self.name, arrays)
        return stock_network(trained, self.build or build_dsnet)

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        trained = TrainedDsnet.from_arrays(self.name, arrays)
        latents_of = applied_dsnet(trained, self.build or build_dsnet)
        return lambda theta, betas: latents_of(join_inputs(theta, betas))


def _without_names(config: Any) -> Any:
    """Keras numbers the names of layers anew in every process."""
    if isinstance(config, dict):
        return {key: _without_names(one) for key, one in config.items() if key != "name"}
    return [*map(_without_names, config)] if isinstance(config, list) else config


def applied_dsnet(
    trained: TrainedDsnet, build: Build = build_dsnet
) -> Callable[[NDArray], NDArray[np.float32]]:
    """A trained DSNet as a function of whole motions: unscaled inputs (T, I) to latents (T, 100).

    I is 79 for the paper's network; others may have other inputs.
    """
    model = with_own_names(build(input_size=len(trained.scaling.input_mean)))
    assign_weights(model, trained.weights)
    return applied(model, trained.scaling)


def applied(model: keras.Model, scaling: Scaling) -> Callable[[NDArray], NDArray[np.float32]]:
    """A trained network as a function of motions: unscaled inputs (T, I) to latents (T, D)."""
    signature = [tf.TensorSpec((None, None, len(scaling.input_mean)), tf.float32)]
    network = tf.function(lambda x: model(x, training=False), input_signature=signature)
    return lambda inputs: scaling.restore(network(scaling.inputs(inputs)[None]).numpy()[0])


def registered_predictors() -> dict[str, Predictor]:
    """Every predictor by name: the paper's network, and those of plugins."""
    faithful = DsnetPredictor("dsnet_faithful", "DSNet, faithful", standardised=False)
    # On the codes of autoencoders that were trained by the paper's words alone.
    literal = (
        DsnetPredictor(name, f"DSNet, {code.replace('_', ' ')}", standardised=False, code=code)
        for code, name in LITERAL_DSNETS.items()
    )
    builtin: tuple[Predictor, ...] = (DsnetPredictor(), faithful, *literal)
    return with_plugins("predictors", {entry.name: entry for entry in builtin})


def predictors_named(names: Iterable[str]) -> list[Predictor]:
    """The predictors of these names; `DsnetError` if one is unknown or repeated, or none given."""
    names, registered = list(names), registered_predictors()
    if not names or len(set(names)) < len(names):
        raise DsnetError(
            f"--predictors {' '.join(names) or '(none)'}",
            f"some of {', '.join(registered)}, each once",
            f"Pass --predictors {' '.join(DSNETS)}.",
        )
    return [entry_named(name, "predictor", registered) for name in names]


def load_predictor(train: Artifact, name: str, body: BodyOf) -> PredictMotion:
    """A trained predictor of a run, for motions of `body`.

    DsnetError if the run has not trained it, it is not registered, or its weights are damaged.
    """
    check_trained(train, name)
    (entry,) = predictors_named([name])
    return entry.load(load_weights(train.file(f"{name}.safetensors")), body)
