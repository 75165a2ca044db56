"""A trained autoencoder with its normaliser: offsets in metres to latents and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.errors import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange.dsnet import AUTOENCODER, LINEAR_FILES, CodeName
from bridge.runs import Artifact
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.normaliser import Normaliser
from torch_align_ae.autoencoder.pca import OffsetCodec, PcaCodec

WEIGHTS_FILE = "autoencoder.safetensors"
_BATCH = 64


@dataclass(frozen=True)
class Codec:
    """Encoder and decoder on NumPy arrays; any number of frames in bounded memory."""

    model: MeshAutoencoder
    normaliser: Normaliser

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets (B, V, 3) in metres to latents (B, 100)."""
        return _in_batches(lambda x: self.model.encode(self.normaliser.normalise(x)), offsets_m)

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Latents (B, 100) to offsets (B, V, 3) in metres."""
        return _in_batches(lambda z: self.normaliser.denormalise(self.model.decode(z)), latents)

    @property
    def vertex_count(self) -> int:
        """V."""
        return len(self.normaliser.mean_m)

    @property
    def latent_size(self) -> int:
        """Numbers kept of a mesh."""
        return self.model.latent_size

    def architecture(self) -> dict[str, Any]:
        """What a manifest must say so that `load_codec` can build the network again."""
        model = self.model
        return {
            "widths": list(model.widths),
            "activation": model.activation,
            "negative_slope": model.negative_slope,
        }

    def save(self, path: Path) -> None:
        """Write weights and normaliser as named arrays."""
        weights = {f"model.{name}": value for name, value in self.model.state_dict().items()}
        weights["normaliser.mean_m"] = self.normaliser.mean_m
        weights["normaliser.scale_m"] = self.normaliser.scale_m
        save_weights(path, {name: value.cpu().numpy() for name, value in weights.items()})


def load_codec(artifact: Artifact, name: str = WEIGHTS_FILE) -> Codec:
    """Load the codec of a finished `train-ae` stage.

    Raises
    ------
    DsnetError
        If the weights are missing, damaged, or of another network.
    """
    return read_codec(artifact.file(name), artifact.manifest["architecture"])


def load_codecs(artifact: Artifact) -> dict[CodeName, OffsetCodec]:
    """Every code of a finished `train-ae` stage.

    Raises
    ------
    DsnetError
        If a file is missing, damaged, or of another code.
    """
    there = artifact.manifest["files"]
    codecs: dict[CodeName, OffsetCodec] = {AUTOENCODER: load_codec(artifact)}
    for code, name in LINEAR_FILES.items():
        if name in there:
            codecs[code] = read_linear(artifact.file(name))
    return codecs


def read_linear(path: Path) -> PcaCodec:
    """Load a linear code from its file."""
    arrays = load_weights(path)
    named = set(arrays) == {"mean_m", "components"}
    if not named or arrays["components"].shape[1:] != (arrays["mean_m"].size,):
        raise DsnetError(
            f"{path} with {', '.join(sorted(arrays)) or 'no arrays'}",
            "mean_m (V, 3) and components (K, V * 3)",
            "Delete the folder and run `dsnet train-ae` again.",
        )
    return PcaCodec(arrays["mean_m"], arrays["components"])


def read_codec(path: Path, architecture: Mapping[str, Any]) -> Codec:
    """Load a codec from its weights and `Codec.architecture`'s values."""
    with torch.device("meta"):
        model = MeshAutoencoder(**{**architecture, "widths": tuple(architecture["widths"])})
    weights = load_weights(path)
    expected = {f"model.{name}": tuple(v.shape) for name, v in model.state_dict().items()}
    vertices = (model.widths[0], 3)
    expected |= {"normaliser.mean_m": vertices, "normaliser.scale_m": vertices}
    if {name: value.shape for name, value in weights.items()} != expected:
        raise DsnetError(
            f"{path} with other arrays than the network in its manifest",
            f"{len(expected)} arrays of widths {model.widths}",
            "Delete the folder and run `dsnet train-ae` again.",
        )
    tensors = {name: torch.from_numpy(value) for name, value in weights.items()}
    normaliser = Normaliser(tensors.pop("normaliser.mean_m"), tensors.pop("normaliser.scale_m"))
    state = {name.removeprefix("model."): value for name, value in tensors.items()}
    model.load_state_dict(state, assign=True)
    return Codec(model.eval(), normaliser)


@torch.inference_mode()
def _in_batches(
    function: Callable[[Tensor], Tensor], values: NDArray[np.float32]
) -> NDArray[np.float32]:
    parts = [
        # A copy, because memory-mapped artifacts are read-only and tensors are not.
        function(torch.from_numpy(np.array(values[start : start + _BATCH], dtype=np.float32)))
        for start in range(0, max(len(values), 1), _BATCH)
    ]
    return torch.cat(parts).numpy()
