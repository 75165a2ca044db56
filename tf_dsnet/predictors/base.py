"""What every predictor is: a name, a label, a training that can be stopped, and predictions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from numpy.typing import NDArray
from tyro.conf import Fixed

from bridge.body import BodyModelData
from bridge.exchange.dsnet import CodeName, UnpaddedClip
from bridge.options import NonNegativeFloat, PositiveFloat, PositiveInt, Seed

PredictMotion = Callable[[NDArray, NDArray], NDArray]
"""Latents (T, 100) of a motion theta (T, 69) of a body of shape betas (10,)."""
BodyOf = Callable[[], BodyModelData]
"""Gives the run's body model; most predictors never ask."""


@dataclass(frozen=True)
class PredictorSettings:
    """What a user may set about how predictors are trained."""

    epochs: PositiveInt = 500
    """Epochs of each predictor (the paper does not say how many)."""
    seed: Seed = 0
    """Seed of the initial weights and of the order of the clips."""
    frames: PositiveInt = 300
    """Length to which sequences are padded or clipped (paper: 300)."""
    batch_size: PositiveInt = 16
    """Sequences in a batch (paper: 16)."""
    lr_faithful: PositiveFloat = 1e-4
    """Adam's learning rate for `dsnet_faithful` (paper: 0.0001)."""
    lr_standardised: PositiveFloat = 1e-3
    """Adam's learning rate for `dsnet_standardised`; a departure where it is not 0.0001."""
    masked: bool = False
    """Leave padded frames out of the loss and of the batch normalisation (the paper does not)."""
    min_input_std: Fixed[NonNegativeFloat] = 0.05
    """Least spread (rad, m or 1) by which `dsnet_standardised` divides an input."""


@dataclass(frozen=True)
class TrainingData:
    """The run's sequences, each at its own length and in its own units; latents of one code."""

    train: list[UnpaddedClip]
    validation: list[UnpaddedClip]
    """Only looked at."""
    body: BodyOf
    """That `theta` moves and `betas` shape."""

    @property
    def people(self) -> int:
        """How many shapes are trained on."""
        return len({clip.betas.tobytes() for clip in self.train})


class PredictorTraining(Protocol):
    """One predictor's training on its way; it may be killed between any two calls."""

    losses: list[float]
    """Of every epoch so far; a checkpoint's are there from the start."""
    validation_losses: list[float]
    """Of every epoch that was validated."""

    @property
    def lr(self) -> float:
        """Learning rate, the chosen one where it was searched for; 0 if there is none."""
        ...

    @property
    def epoch_s(self) -> float | None:
        """Mean seconds of this process's epochs; None if there were none."""
        ...

    def epoch(self, number: int, *, validate: bool) -> None:
        """Train for epoch `number`, unless the checkpoint was behind it already."""
        ...

    def save(self) -> None:
        """Write the checkpoint."""
        ...

    def arrays(self) -> dict[str, NDArray]:
        """What has been learned: all that `Predictor.load` needs."""
        ...

    def parameters(self) -> dict[str, int]:
        """How many numbers are learned, by name of the count."""
        ...


class Predictor(Protocol):
    """An entry of the registry; predictors that learn in one go train for one epoch."""

    @property
    def name(self) -> str:
        """In options, file names and manifests."""
        ...

    @property
    def label(self) -> str:
        """In tables and legends."""
        ...

    @property
    def code(self) -> CodeName:
        """Which latents it learns."""
        ...

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
