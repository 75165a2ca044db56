"""The paper's DSNet as two predictors, for it is silent about the scale of motions and latents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.dsnet import (
    AUTOENCODER,
    CodeName,
    Scaling,
    TrainedDsnet,
    fit_scaling,
    join_inputs,
    make_clips,
)
from tf_dsnet.framework import tf
from tf_dsnet.model import assign_weights, build_dsnet
from tf_dsnet.predictors.base import BodyOf, PredictMotion, PredictorSettings, TrainingData
from tf_dsnet.trainer import DsnetTraining, Trainer

PAPER_LR = 1e-4
"""Adam's learning rate in Section 5."""


@dataclass(frozen=True)
class FaithfulDsnet:
    """The paper's words and nothing else: raw motions in, latents as the autoencoder gives them."""

    name: str = "dsnet_faithful"
    label: str = "DSNet, faithful"
    code: CodeName = AUTOENCODER

    def lr(self, settings: PredictorSettings) -> float:
        """Adam's learning rate."""
        return settings.lr_faithful

    def scaling(self, settings: PredictorSettings, data: TrainingData) -> Scaling:
        """How inputs and latents are scaled."""
        return Scaling.identity()

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        found = []
        if (lr := self.lr(settings)) != PAPER_LR:
            found.append(f"Adam's learning rate is {lr:g} instead of {PAPER_LR:g}")
        if settings.masked:
            found.append("padded frames are left out of the loss and of the batch normalisation")
        return tuple(found)

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> DsnetTraining:
        """Begin training, or go on from `checkpoint` if that file is there."""
        scaling = self.scaling(settings, data)
        train, validation = (
            make_clips(part, scaling, settings.frames) for part in (data.train, data.validation)
        )
        trainer = Trainer(
            train,
            lr=self.lr(settings),
            batch_size=settings.batch_size,
            masked=settings.masked,
            seed=settings.seed,
        )
        trainer.trace()
        return DsnetTraining(self.name, trainer, scaling, validation, checkpoint)

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """A trained network, applied to whole motions."""
        return DsnetOfMotions(TrainedDsnet.from_arrays(self.name, arrays))


@dataclass(frozen=True)
class StandardisedDsnet(FaithfulDsnet):
    """Inputs and latents scaled, which decides how fast Adam learns."""

    name: str = "dsnet_standardised"
    label: str = "DSNet, standardised"

    def lr(self, settings: PredictorSettings) -> float:
        """Adam's learning rate."""
        return settings.lr_standardised

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        scaled = "inputs and latents are standardised over the training frames"
        return (scaled, *super().departures(settings))

    def scaling(self, settings: PredictorSettings, data: TrainingData) -> Scaling:
        """Mean and spread of the training frames."""
        return fit_scaling(data.train, settings.min_input_std)


class DsnetOfMotions:
    """A trained DSNet, applied to whole motions; it may be told of I numbers other than the 79.

    Raises
    ------
    DsnetError
        If the weights are not DSNet's.
    """

    def __init__(self, trained: TrainedDsnet) -> None:
        self._scaling = trained.scaling
        size = len(trained.scaling.input_mean)
        model = build_dsnet(input_size=size)
        assign_weights(model, trained.weights)
        signature = [tf.TensorSpec((None, None, size), tf.float32)]
        self._network = tf.function(lambda x: model(x, training=False), input_signature=signature)

    def __call__(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """Latents (T, 100) of a motion theta (T, 69) of a body of shape betas (10,)."""
        return self.of_inputs(join_inputs(theta, betas))

    def of_inputs(self, inputs: NDArray) -> NDArray[np.float32]:
        """Latents (T, 100) of inputs (T, I) in a motion's own units."""
        outputs = self._network(self._scaling.inputs(inputs)[None])
        return self._scaling.restore(outputs.numpy()[0])
