"""What compared networks share: told of a motion, scaled, trained with a search, applied."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from numpy.typing import NDArray

from benchmarks.systems.rate_search import RATES, SEARCH_SHARE, RateSearch
from bridge.exchange.dsnet import (
    Clips,
    CodeName,
    Scaling,
    TrainedDsnet,
    UnpaddedClip,
    fit_scaling,
    join_inputs,
    make_clips,
)
from bridge.exchange.train_options import PredictorSettings
from bridge.exchange.weights import refuse_nonfinite
from tf_dsnet.framework import keras
from tf_dsnet.model import assign_weights, sum_of_distances
from tf_dsnet.predictors import (
    BodyOf,
    PredictMotion,
    TrainingData,
    applied,
)
from tf_dsnet.trainer import LossOf, Trainer

_REMEDY = "Leave this predictor out: dsnet train --help names the others."


@dataclass(frozen=True)
class SearchedNetwork(ABC):
    """A Keras network from whole motions to latents, standardised on both sides."""

    name: str
    label: str
    code: CodeName = "pca"
    """Which latents it learns."""
    masked: bool = False
    """Leave padded frames out of the loss and of the batch normalisation."""

    @abstractmethod
    def told(self, joined: NDArray, body: BodyOf) -> NDArray:
        """What it is told, (T, I), of a motion's betas and theta (T, 79)."""

    @abstractmethod
    def build(self, *, input_size: int, masked: bool = False, people: int = 1) -> keras.Model:
        """The network, fresh: (B, T, I), and (B, T) real frames if masked, to (B, T, 100)."""

    def scaling(self, train: list[UnpaddedClip], settings: PredictorSettings) -> Scaling:
        """How inputs and latents are scaled, of what is told of the training clips."""
        return fit_scaling(train, settings.min_input_std)

    def examples(self, clips: Clips) -> Clips:
        """What is learned from, of scaled clips; most learn from these."""
        return clips

    def prepare(self, model: keras.Model, clips: Clips) -> None:  # noqa: B027
        """Set what is not learned by descent, of the training clips; most have nothing."""

    def loss_for(self, clips: Clips) -> LossOf:
        """The loss, which may depend on the training clips; the paper's does not."""
        return sum_of_distances

    def departures(self, settings: PredictorSettings) -> tuple[str, ...]:
        """Where it leaves the paper."""
        tried = ", ".join(f"{rate:g}" for rate in RATES)
        found = [
            "inputs and latents are standardised over the training frames",
            f"of Adam's rates {tried} and of the epochs those with the least validation loss; "
            f"{SEARCH_SHARE:.0%} of the epochs go to each rate",
        ]
        if self.code == "pca":
            found.append("learns PCA coefficients in place of the autoencoder's latents")
        if self.masked or settings.masked:
            found.append("padded frames are left out of the loss and of the batch normalisation")
        return tuple(found)

    def training(
        self, settings: PredictorSettings, data: TrainingData, checkpoint: Path
    ) -> RateSearch:
        """Begin training, or go on from `checkpoint` if that file is there."""
        train, validation = (
            [replace(clip, inputs=self.told(clip.inputs, data.body)) for clip in part]
            for part in (data.train, data.validation)
        )
        scaling = self.scaling(train, settings)
        clips, held_out = (
            self.examples(make_clips(part, scaling, settings.frames))
            for part in (train, validation)
        )
        masked = self.masked or settings.masked
        people = len({clip.betas.tobytes() for clip in data.train})
        trainer = Trainer(
            clips,
            lr=RATES[0],
            batch_size=settings.batch_size,
            masked=masked,
            seed=settings.seed,
            build=partial(self.build, masked=masked, people=people),
            loss_of=self.loss_for(clips),
        )
        self.prepare(trainer.model, clips)
        trainer.trace()
        return RateSearch(
            self.name,
            trainer,
            settings.epochs,
            partial(trainer.loss, held_out),
            partial(self._finished, scaling),
            checkpoint,
        )

    def load(self, arrays: Mapping[str, NDArray], body: BodyOf) -> PredictMotion:
        """A trained network, applied to whole motions."""
        trained = TrainedDsnet.from_arrays(self.name, arrays)
        model = self.rebuilt(trained.weights, len(trained.scaling.input_mean))
        latents_of = applied(model, trained.scaling)
        return lambda theta, betas: latents_of(self.told(join_inputs(theta, betas), body))

    def rebuilt(self, weights: Mapping[str, NDArray], input_size: int) -> keras.Model:
        """The network with trained weights."""
        model = self.build(input_size=input_size, people=self.people_in(weights))
        assign_weights(model, weights)
        return model

    def people_in(self, weights: Mapping[str, NDArray]) -> int:
        """How many people it was trained on, where its weights depend on that."""
        return 1

    def _finished(self, scaling: Scaling, weights: Mapping[str, NDArray]) -> dict[str, NDArray]:
        refuse_nonfinite(weights, self.name, _REMEDY)
        return TrainedDsnet(self.name, weights, scaling).arrays()
