"""The ways in which the autoencoder is trained, and what each departs from in the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from torch_align_ae.autoencoder.initialisation import InitialisationName
from torch_align_ae.autoencoder.mesh_autoencoder import ActivationName
from torch_align_ae.autoencoder.normaliser import NormalisationName

PresetName = Literal["literal", "measured", "short"]


@dataclass(frozen=True)
class TrainingPreset:
    """What the paper leaves open about the autoencoder's training, decided one way."""

    normalisation: NormalisationName
    """What is scaled by what before it enters the network."""
    activation: ActivationName
    """Nonlinearity; the paper names none."""
    negative_slope: float
    """Slope of leaky_relu below zero."""
    initialisation: InitialisationName
    """How the weights begin; the paper does not say."""
    learning_rate: float
    """Adam's; the paper's is 1e-4."""
    warmup_steps: int
    """Steps over which the learning rate rises linearly from zero."""
    cosine_decay: bool
    """Whether the learning rate then falls to zero along a cosine."""
    departures: tuple[str, ...]
    """Where this preset leaves the paper's words or its plainest meaning."""
    learning_rate_of_loss: float = 0.0
    """If not 0, the learning rate is this times the validation loss before the first step."""


_OF_LINEAR_CODE = (
    "offsets have their mean removed and are divided by one standard deviation, "
    "so that values leave [-1, 1]",
    "the weights begin as a linear code of the leading vertex modes of training frames",
)
_MEASURED = TrainingPreset(
    normalisation="standard",
    activation="leaky_relu",
    negative_slope=0.1,
    initialisation="modes",
    learning_rate=1e-4,
    warmup_steps=20,
    cosine_decay=True,
    departures=(
        *_OF_LINEAR_CODE,
        "the learning rate rises over 20 steps to the paper's 1e-4 and falls along a cosine",
    ),
)

PRESETS: dict[PresetName, TrainingPreset] = {
    "literal": TrainingPreset(
        normalisation="global_maximum",
        activation="leaky_relu",
        negative_slope=0.1,
        initialisation="torch",
        learning_rate=1e-4,
        warmup_steps=0,
        cosine_decay=False,
        departures=(),
    ),
    "measured": _MEASURED,
    # Adam's rate decides how far training first moves away from the linear code, and how near it
    # comes back in few steps: it has to suit the error that this code begins with.
    "short": replace(
        _MEASURED,
        learning_rate_of_loss=0.0134,
        departures=(
            *_OF_LINEAR_CODE,
            "the learning rate is in proportion to the linear code's validation error (1e-3 for "
            "an error of 0.075) instead of 1e-4; it rises over 20 steps and falls along a cosine",
        ),
    ),
}
"""The paper's words taken literally, and what learns on these data."""
