"""What the presets of DSNet share: the paper's network, its training and its predictions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.clips import UnpaddedClip, join_inputs, make_clips
from bridge.exchange.codes import AUTOENCODER, CodeName
from bridge.exchange.input_kinds import POSES, InputKind
from bridge.exchange.trained_dsnet import Scaling, TrainedDsnet
from tf_dsnet.framework import tf
from tf_dsnet.model import assign_weights, build_dsnet
from tf_dsnet.predictors.base import BodyOf, PredictorSettings, TrainingData
from tf_dsnet.trainer import DsnetTraining, Trainer

PAPER_LR = 1e-4
"""Adam's learning rate in Section 5."""


@dataclass(frozen=True)
class DsnetPredictor(ABC):
    """DSNet with one choice of the scale of its inputs and latents, which the paper leaves open."""

    name: str
    label: str
    preset: str

    @property
    def code(self) -> CodeName:
        """The paper's."""
        return AUTOENCODER

    @property
    def input_kind(self) -> InputKind:
        """What the network is told of a motion."""
        return POSES

    @abstractmethod
    def lr(self, settings: PredictorSettings) -> float:
        """Adam's learning rate."""

    @abstractmethod
    def scaling(self, settings: PredictorSettings, data: TrainingData) -> Scaling:
        """How inputs and latents are scaled."""

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
        data = replace(
            data, train=self._inputs(data.train), validation=self._inputs(data.validation)
        )
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

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> DsnetOfMotions:
        """A trained network, applied to whole motions."""
        return DsnetOfMotions(TrainedDsnet.from_arrays(self.name, arrays))

    def _inputs(self, clips: list[UnpaddedClip]) -> list[UnpaddedClip]:
        return [replace(clip, inputs=self.input_kind.of(clip.inputs)) for clip in clips]


class DsnetOfMotions:
    """A trained DSNet, applied to whole motions.

    Raises
    ------
    DsnetError
        If the weights are not DSNet's.
    """

    def __init__(self, trained: TrainedDsnet) -> None:
        self._trained = trained
        input_size = trained.input_kind.size
        model = build_dsnet(input_size=input_size)
        assign_weights(model, trained.weights)
        signature = [tf.TensorSpec((None, None, input_size), tf.float32)]
        self._network = tf.function(lambda x: model(x, training=False), input_signature=signature)

    def __call__(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """Latents (T, 100) of a motion theta (T, 69) of a body of shape betas (10,)."""
        inputs = self._trained.inputs(join_inputs(theta, betas))
        return self._trained.scaling.restore(self._network(inputs[None]).numpy()[0])
