"""The steps from the paper's literal pipeline to the one that a run shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Step:
    """An autoencoder's training, or a predictor on the codes of the last one."""

    name: str
    """Ends the name of its run."""
    text: str
    """What it does otherwise than the step before it."""
    normalisation: Literal["global_maximum", "coordinate_range", "standard"] = "standard"
    initialisation: Literal["torch", "modes"] = "modes"
    rate_varies: bool = False
    """Whether the learning rate rises over 20 steps and falls along a cosine."""
    predictor: str = "dsnet_faithful"


AUTOENCODERS = (
    Step("literal", "the paper's words; all offsets by one number", "global_maximum", "torch"),
    Step(
        "literal_per_coordinate",
        "the paper's words; each coordinate by its own range",
        "coordinate_range",
        "torch",
    ),
    Step(
        "standard",
        "mean removed, one standard deviation: values leave [-1, 1]",
        "standard",
        "torch",
    ),
    Step("modes", "and weights that begin as a linear code of vertex modes"),
    Step("rate", "and a rate that rises to 1e-4 and falls", rate_varies=True),
)
"""Each keeps what the one before it departs in, but for the two readings of [-1, 1]."""

PREDICTORS = (
    Step(
        "standardised",
        "and DSNet's inputs and latents standardised",
        predictor="dsnet_standardised_1e-4",
    ),
    Step("fast", "and DSNet's rate 1e-3", predictor="dsnet_standardised"),
)
"""On the codes of the last autoencoder."""
