"""What a user may set about the training of predictors; no framework is needed to say it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from tyro.conf import Fixed

from bridge.options import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, Seed


@dataclass(frozen=True)
class PredictorSettings:
    """What a user may set about how predictors are trained."""

    epochs: PositiveInt = 500
    """Epochs of each network (the paper states no number)."""
    seed: Seed = 0
    """Seed of the initial weights and of the order of the clips."""
    frames: Fixed[PositiveInt] = 300
    """Length to which sequences are padded or clipped (paper: 300)."""
    batch_size: Fixed[PositiveInt] = 16
    """Sequences in a batch (paper: 16)."""
    lr_faithful: Fixed[PositiveFloat] = 1e-4
    """Adam's learning rate for `dsnet_faithful` and `dsnet_literal` (paper: 0.0001)."""
    lr_standardised: Fixed[PositiveFloat] = 1e-3
    """Adam's learning rate for `dsnet_standardised`; a departure where it is not 0.0001."""
    masked: Fixed[bool] = False
    """Leave padded frames out of the loss and of the batch normalisation (the paper does not)."""
    min_input_std: Fixed[NonNegativeFloat] = 0.05
    """Least spread (rad, m or 1) by which `dsnet_standardised` divides an input."""
    lstm: Literal["block", "stock"] = "block"
    """What computes the LSTM in training: `block`, one operation for all frames, twice as fast on a
    CPU; `stock`, Keras's own layer. Weights differ by rounding, and either opens as the other."""


@dataclass(frozen=True)
class NetworksRecord(PredictorSettings):
    """What decides whether an artifact of the networks is current."""

    predictors: tuple[str, ...] = ()
    """Predictors to train; by default all that the run has data for. `dsnet_faithful`: raw inputs
    and latents. `dsnet_standardised`: both standardised, of which the paper says nothing.
    `dsnet_literal`, `dsnet_literal_per_coordinate`: `dsnet_faithful` on latents of an autoencoder
    that was trained by the paper's words alone.
    `dsnet_plus`: oscillators on the skin, trained on offsets of the robust aligner. Others come
    from the modules that DSNET_PLUGINS names. Networks that the run has trained on the same latents
    are kept beside them; `report` shows the first one."""
    validate_every: Fixed[PositiveInt] = 10
    """Epochs between two validation losses."""
    checkpoint_every: Fixed[PositiveInt] = 100
    """Epochs between two checkpoints."""


def settings_of(train: Mapping[str, Any]) -> Mapping[str, Any]:
    """With which settings the default predictor of a manifest was trained; each network of `train`
    has its own."""
    config = train["config"]
    of_each = config.get("predictors")
    return of_each[train["default"]] if isinstance(of_each, Mapping) else config


@dataclass(frozen=True)
class TrainPlusConfig:
    """Fit `dsnet_plus` to the training sequences of the best alignment.

    Costs about two minutes on two cores for 40 sequences of 160 frames, 1 GB.
    """

    run: str = "demo"
    """Run whose aligned offsets are learned."""
    seed: Seed = 0
    """Seed of the windows' order."""
    nodes: PositiveInt = 500
    """Vertices that carry the tissue; the others follow smoothly."""
    rounds: PositiveInt = 9
    """Rounds of training; each begins with a simulation of every clip."""
    steps: PositiveInt = 25
    """Adam's steps in a round."""
    window: PositiveInt = 36
    """Frames that a step simulates."""
    batch_size: PositiveInt = 12
    """Windows in a step."""
    lr: PositiveFloat = 0.06
    """Adam's learning rate at the start, for logarithms of coefficients; it falls to 0."""
    taps: PositiveInt = 3
    """Frames of the load that act on a step."""
    look_ahead: NonNegativeInt = 1
    """Frames by which the newest of them lies ahead of the step; 0 needs no later pose."""
