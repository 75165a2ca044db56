"""The two readings of a paper that is silent about the scale of inputs and latents.

`faithful` feeds raw motions and the latents as the autoencoder gives them.
`standardised` departs from the paper: inputs and latents have zero mean and
unit spread over the training frames, which decides how fast Adam learns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.paper import INPUT_SIZE
from bridge.runs import Artifact

PresetName = Literal["standardised", "faithful"]
PRESETS: tuple[PresetName, ...] = get_args(PresetName)


@dataclass(frozen=True, eq=False)
class Scaling:
    """An affine map from a motion's own units to the network's, and back for latents."""

    input_mean: NDArray[np.float32]
    """(79,) subtracted from betas and theta."""
    input_std: NDArray[np.float32]
    """(79,) then divided by."""
    latent_mean: NDArray[np.float32]
    """(100,) subtracted from latents."""
    latent_std: NDArray[np.float32]
    """(100,) then divided by."""

    @classmethod
    def identity(cls, latent_size: int = 100) -> Scaling:
        """The `faithful` reading's: nothing is changed."""
        sizes = (INPUT_SIZE, latent_size)
        zeros, ones = ([f(size, np.float32) for size in sizes] for f in (np.zeros, np.ones))
        return cls(zeros[0], ones[0], zeros[1], ones[1])

    @classmethod
    def fitted(cls, inputs: NDArray, latents: NDArray, min_input_std: float) -> Scaling:
        """Statistics of the training frames `inputs` (F, 79) and `latents` (F, 100).

        Inputs are scaled one by one, for they differ in unit; a spread below `min_input_std`
        (of a joint that hardly turns) is raised to it, so that noise is not magnified. Latents
        share one scale, the root mean square of their spreads: each scaled by its own, dead
        dimensions would count as much as those that move the skin (validation R2 after 160
        epochs on PCA latents of the synthetic corpus: 0.62 with one scale, 0.14 with a hundred).
        """
        inputs, latents = inputs.astype(np.float64), latents.astype(np.float64)
        latent_std = np.sqrt(latents.var(axis=0).mean()) or 1.0
        return cls(
            inputs.mean(axis=0).astype(np.float32),
            np.maximum(inputs.std(axis=0), min_input_std).astype(np.float32),
            latents.mean(axis=0).astype(np.float32),
            np.full(latents.shape[1], latent_std, np.float32),
        )

    def inputs(self, inputs: NDArray) -> NDArray[np.float32]:
        """Betas and theta (..., 79) as the network is given them."""
        return ((inputs - self.input_mean) / self.input_std).astype(np.float32)

    def latents(self, latents: NDArray) -> NDArray[np.float32]:
        """Latents (..., 100) as the network learns them."""
        return ((latents - self.latent_mean) / self.latent_std).astype(np.float32)

    def restore(self, outputs: NDArray) -> NDArray[np.float32]:
        """The network's outputs (..., 100) as the autoencoder's latents."""
        return (outputs * self.latent_std + self.latent_mean).astype(np.float32)


@dataclass(frozen=True, eq=False)
class TrainedDsnet:
    """A trained DSNet as arrays."""

    name: PresetName
    weights: Mapping[str, NDArray]
    """Named as by `tf_dsnet.model.named_weights`."""
    scaling: Scaling


def load_trained_dsnet(train: Artifact, name: PresetName | None = None) -> TrainedDsnet:
    """Read one reading from the `train` stage's artifact; the run's own choice when None.

    Raises
    ------
    DsnetError
        If that reading was not trained in this run.
    """
    chosen: PresetName = name or train.manifest["reading"]
    if chosen not in train.manifest["readings"]:
        raise DsnetError(
            f"reading {chosen!r} asked of {train.path}",
            f"one of {', '.join(train.manifest['readings'])}",
            f"Train it: dsnet train --readings {' '.join(PRESETS)}.",
        )
    weights = load_weights(train.file(f"{chosen}.safetensors"))
    if chosen == "faithful":
        return TrainedDsnet(chosen, weights, Scaling.identity())
    names = ("input_mean", "input_std", "latent_mean", "latent_std")
    return TrainedDsnet(chosen, weights, Scaling(*(np.array(train.array(name)) for name in names)))
