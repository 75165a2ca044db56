"""A trained autoencoder with its normaliser, in Keras: offsets in metres to latents and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.runs import Artifact
from tf_dsnet.framework import Tensor, tf
from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder, assign_weights

WEIGHTS_FILE = "autoencoder.safetensors"
_BATCH = 64


@dataclass(frozen=True, eq=False)
class KerasCodec:
    """Encoder and decoder on NumPy arrays; any number of frames in bounded memory."""

    network: KerasMeshAutoencoder
    mean_m: NDArray[np.floating]
    """(V, 3), metres, subtracted from offsets."""
    scale_m: NDArray[np.floating]
    """(V, 3), metres, then divided by."""

    def encode(self, offsets_m: NDArray) -> NDArray:
        """Offsets (B, V, 3) in metres to latents (B, 100)."""
        return _in_batches(lambda x: self.network.encode(self.normalise(x)), offsets_m)

    def decode(self, latents: NDArray) -> NDArray:
        """Latents (B, 100) to offsets (B, V, 3) in metres."""
        return _in_batches(lambda z: self.denormalise(self.network.decode(z)), latents)

    def normalise(self, offsets_m: Tensor) -> Tensor:
        """Metres (B, V, 3) to the network's numbers."""
        return (offsets_m - self.mean_m) / self.scale_m

    def denormalise(self, values: Tensor) -> Tensor:
        """The network's numbers (B, V, 3) to metres."""
        return values * self.scale_m + self.mean_m


def load_codec(artifact: Artifact, name: str = WEIGHTS_FILE) -> KerasCodec:
    """Load the codec of a finished `train-ae` stage.

    Raises
    ------
    DsnetError
        If the weights are missing, damaged, or of another network.
    """
    return read_codec(artifact.file(name), artifact.manifest["architecture"])


def read_codec(path: Path, architecture: Mapping[str, Any]) -> KerasCodec:
    """Load a codec from its weights and the network's widths and activation."""
    arrays = load_weights(path)
    network = KerasMeshAutoencoder(**architecture)
    shape = (network.widths[0], 3)
    normaliser = [arrays.pop(f"normaliser.{name}", np.empty(0)) for name in ("mean_m", "scale_m")]
    if odd := [array.shape for array in normaliser if array.shape != shape]:
        raise DsnetError(
            f"{path} with a normaliser of shape {odd[0]}",
            f"normaliser.mean_m and normaliser.scale_m of shape {shape}",
            "Delete the folder and run `dsnet train-ae` again.",
        )
    weights = {name.removeprefix("model."): array for name, array in arrays.items()}
    assign_weights(network.model, weights)
    return KerasCodec(network, *normaliser)


def _in_batches(function: Callable[[Tensor], Tensor], values: NDArray) -> NDArray:
    starts = range(0, max(len(values), 1), _BATCH)
    parts = [function(tf.constant(values[start : start + _BATCH])) for start in starts]
    return tf.concat(parts, 0).numpy()
