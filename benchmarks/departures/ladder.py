"""The steps from the literal pipeline to this repository's, each with one departure more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Code:
    """An alignment and the autoencoder that is trained on its offsets."""

    normalisation: Literal["global_maximum", "coordinate_range", "standard"] = "standard"
    initialisation: Literal["torch", "modes"] = "modes"
    rate_varies: bool = True
    """Whether the learning rate rises over 20 steps to 1e-4 and falls along a cosine."""
    aligner: Literal["sgd", "robust"] = "sgd"


@dataclass(frozen=True)
class Step:
    """A predictor on a code, beside the step before it."""

    text: str
    """What it does otherwise."""
    code: str
    """Which of `CODES`; ends the name of its run."""
    predictor: str = "dsnet_faithful"


CODES: Mapping[str, Code] = {
    "literal": Code("global_maximum", "torch", rate_varies=False),
    "literal_per_coordinate": Code("coordinate_range", "torch", rate_varies=False),
    "standard": Code(initialisation="torch", rate_varies=False),
    "modes": Code(rate_varies=False),
    "rate": Code(),
    "robust": Code(aligner="robust"),
}

STEPS = (
    Step("the paper's words; [-1, 1] by one number for all offsets", "literal"),
    Step("the paper's words; [-1, 1] by each coordinate's own range", "literal_per_coordinate"),
    Step("offsets without their mean, by one standard deviation: they leave [-1, 1]", "standard"),
    Step("and an autoencoder that begins as a linear code of vertex modes", "modes"),
    Step("and a rate that rises to 1e-4 and falls", "rate"),
    Step("and DSNet's inputs and latents standardised", "rate", "dsnet_standardised_1e-4"),
    Step("and DSNet's rate 1e-3", "rate", "dsnet_standardised"),
    Step("and the robust aligner", "robust", "dsnet_standardised"),
    Step("and DSNet+ in place of autoencoder and DSNet", "robust", "dsnet_plus"),
)
"""Each keeps what the one before it departs in, but for the two readings of [-1, 1]."""
