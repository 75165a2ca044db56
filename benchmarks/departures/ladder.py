"""The steps from the literal pipeline to this repository's, each with one departure more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Code:
    """An alignment, and how the autoencoder is trained on its offsets."""

    initialisation: Literal["torch", "modes"] = "modes"
    rate_varies: bool = True
    """Whether the learning rate rises over 20 steps to 1e-4 and falls along a cosine."""
    aligner: Literal["sgd", "robust"] = "sgd"


@dataclass(frozen=True)
class Step:
    """A predictor on a code, beside the step before it."""

    text: str
    """What it does otherwise."""
    predictor: str
    code: str = ""
    """Which of `CODES`, of a run of its own; else the predictor is one of the run that is shown."""


CODES: Mapping[str, Code] = {
    "standard": Code("torch", rate_varies=False),
    "modes": Code(rate_varies=False),
    "rate": Code(),
    "robust": Code(aligner="robust"),
}
"""Each normalises by one standard deviation, so that values leave [-1, 1]."""

STEPS = (
    Step("the paper's words; [-1, 1] by one number for all offsets", "dsnet_literal"),
    Step(
        "the paper's words; [-1, 1] by each coordinate's own range", "dsnet_literal_per_coordinate"
    ),
    Step("offsets without their mean, by one deviation", "dsnet_faithful", "standard"),
    Step("and an autoencoder that begins as a linear code", "dsnet_faithful", "modes"),
    Step("and a rate that rises to 1e-4 and falls", "dsnet_faithful", "rate"),
    Step("and DSNet's inputs and latents standardised", "dsnet_standardised_1e-4", "rate"),
    Step("and DSNet's rate 1e-3", "dsnet_standardised", "rate"),
    Step("and the robust aligner", "dsnet_standardised", "robust"),
    Step("and DSNet+ in place of autoencoder and DSNet", "dsnet_plus"),
)
"""Each keeps what the one before it departs in, but for the two readings of [-1, 1]."""
