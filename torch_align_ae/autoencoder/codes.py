"""Codecs of offsets: the trained autoencoder with its normaliser, and PCA for comparison."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.errors import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange.dsnet import AUTOENCODER, LINEAR_FILES, LITERAL_CODES, CodeName
from bridge.exchange.weights import check_shapes
from bridge.motion.splits import chunks
from bridge.runs import Artifact
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder

NormalisationName = Literal["global_maximum", "coordinate_range", "standard"]
_BATCH = 64
# Without a least scale, coordinates that hardly move would be scaled up to mere noise.
_SMALLEST_SCALE_M = 1e-4
_SPARE_DIRECTIONS, _PASSES = 20, 3


def weights_file(code: CodeName) -> str:
    """File of a trained autoencoder's weights in a `train-ae` artifact."""
    return f"{code}.safetensors"


class Normaliser(nn.Module):
    """An affine map per coordinate: (offset - mean) / scale, and back; both (V, 3), metres."""

    mean_m: Tensor
    scale_m: Tensor

    def __init__(self, mean_m: Tensor, scale_m: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean_m", mean_m)
        self.register_buffer("scale_m", scale_m)

    def normalise(self, offsets_m: Tensor) -> Tensor:
        return (offsets_m - self.mean_m) / self.scale_m

    def denormalise(self, values: Tensor) -> Tensor:
        return values * self.scale_m + self.mean_m


def fit_normaliser(
    name: NormalisationName, offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> Normaliser:
    """Fit a normaliser to the training `frames` of offsets (F, V, 3), metres.

    The paper says 'normalized ... within the range of [-1, 1]' (Section 5). As offsets are a
    millimetre on average and several centimetres at most, the choice decides how well they are
    learned:

    `global_maximum`
        Divide by the largest coordinate of all; zero stays zero.
    `coordinate_range`
        Map each coordinate of each vertex from its own least and largest value to -1 and 1.
    `standard`
        Subtract the mean and divide by one standard deviation; values leave [-1, 1]. The mean
        squared error is then that of the offsets, up to a constant factor.
    """
    total = np.zeros(offsets_m.shape[1:])
    squares = 0.0
    least, largest = np.full_like(total, np.inf), np.full_like(total, -np.inf)
    for part in chunks(offsets_m, frames):
        total += part.sum(axis=0, dtype=np.float64)
        squares += float(np.square(part, dtype=np.float64).sum())
        least = np.minimum(least, part.min(axis=0))
        largest = np.maximum(largest, part.max(axis=0))
    zero = np.zeros_like(total)
    if name == "standard":
        zero = total / len(frames)
        variance = squares / (len(frames) * total.size) - np.square(zero).mean()
        scale = np.full_like(zero, np.sqrt(max(variance, 0.0)))
    elif name == "coordinate_range":
        zero, scale = (largest + least) / 2, (largest - least) / 2
    else:
        scale = np.full_like(zero, max(-least.min(), largest.max()))
    scale = np.maximum(scale, _SMALLEST_SCALE_M)
    return Normaliser(*(torch.from_numpy(part.astype(np.float32)) for part in (zero, scale)))


class Codec(nn.Module):
    """A trained autoencoder with its normaliser, for NumPy arrays of any number of frames."""

    def __init__(self, model: MeshAutoencoder, normaliser: Normaliser) -> None:
        super().__init__()
        self.model, self.normaliser = model, normaliser

    @classmethod
    def empty(cls, architecture: Mapping[str, Any]) -> Codec:
        """A codec by `Codec.architecture`'s values, without memory for its weights."""
        with torch.device("meta"):
            model = MeshAutoencoder(tuple(architecture["widths"]))
            return cls(model, Normaliser(*torch.empty(2, model.widths[0], 3)))

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets (B, V, 3) in metres to latents (B, 100)."""
        return self._applied(lambda x: self.model.encode(self.normaliser.normalise(x)), offsets_m)

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Latents (B, 100) to offsets (B, V, 3) in metres."""
        return self._applied(lambda z: self.normaliser.denormalise(self.model.decode(z)), latents)

    @torch.inference_mode()
    def _applied(
        self, function: Callable[[Tensor], Tensor], values: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        parts = []
        for start in range(0, max(len(values), 1), _BATCH):
            # A copy, as memory-mapped artifacts are read-only and tensors cannot be.
            batch = torch.from_numpy(np.array(values[start : start + _BATCH], dtype=np.float32))
            parts.append(function(batch.to(self.normaliser.mean_m.device)).cpu())
        return torch.cat(parts).numpy()

    @property
    def latent_size(self) -> int:
        return self.model.latent_size

    def architecture(self) -> dict[str, Any]:
        """The values in a manifest by which `load_codec` builds the network."""
        return {"widths": self.model.widths}

    def save(self, path: Path) -> None:
        save_weights(path, {name: v.cpu().numpy() for name, v in self.state_dict().items()})


@dataclass(frozen=True)
class PcaCodec:
    """Mean and principal directions of offsets; encodes to coefficients in metres."""

    mean_m: NDArray[np.float32]  # (V, 3)
    components: NDArray[np.float32]  # (K, V * 3), orthonormal rows, in order of falling variance

    @classmethod
    def fit(
        cls,
        offsets_m: NDArray[np.float32],
        frames: NDArray[np.int64],
        size: int = 100,
        seed: int = 0,
    ) -> PcaCodec:
        """Fit `size` components to `frames` of offsets (F, V, 3), which need not fit into memory.

        Randomised subspace iteration (Halko, Martinsson, Tropp 2011): each pass reads the frames
        once and multiplies the subspace by their covariance.
        """
        total = np.zeros(offsets_m.shape[1:])
        for part in chunks(offsets_m, frames):
            total += part.sum(axis=0, dtype=np.float64)
        mean = (total / len(frames)).astype(np.float32)
        width = min(size + _SPARE_DIRECTIONS, mean.size)
        subspace = np.random.default_rng(seed).standard_normal((mean.size, width), np.float32)
        basis, inner = subspace, np.empty(0)
        for _ in range(_PASSES):
            # (X'X) basis, and basis' (X'X) basis, of the centred frames X.
            basis = np.linalg.qr(subspace)[0]
            subspace, inner = np.zeros_like(basis), np.zeros((width, width))
            for part in chunks(offsets_m, frames):
                centred = (part - mean).reshape(len(part), -1)
                coefficients = centred @ basis
                subspace += centred.T @ coefficients
                inner += np.float64(coefficients.T @ coefficients)
        rotation = np.linalg.eigh(inner)[1][:, ::-1][:, :size]
        return cls(mean, np.ascontiguousarray((basis @ rotation.astype(np.float32)).T))

    @classmethod
    def of_directions(cls, directions: NDArray[np.floating]) -> PcaCodec:
        """A codec by directions (V, 3, K) about zero, which are made orthonormal in their order."""
        columns = directions.reshape(-1, directions.shape[2]).astype(np.float64)
        basis, upper = np.linalg.qr(columns)
        components = (basis * np.where(np.diag(upper) < 0, -1.0, 1.0)).T.astype(np.float32)
        return cls(np.zeros(directions.shape[:2], np.float32), np.ascontiguousarray(components))

    @property
    def latent_size(self) -> int:
        return len(self.components)

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets (B, V, 3) in metres to coefficients (B, K) in metres."""
        centred = np.asarray(offsets_m - self.mean_m, dtype=np.float32)
        return _product(centred.reshape(len(offsets_m), -1), self.components.T)

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Coefficients (B, K) to offsets (B, V, 3) in metres."""
        offsets_m = _product(latents, self.components).reshape(-1, *self.mean_m.shape)
        return offsets_m + self.mean_m


def _product(left: NDArray[np.float32], right: NDArray[np.float32]) -> NDArray[np.float32]:
    """The product by PyTorch, as NumPy's bits depend on the number of cores."""
    return (torch.tensor(left) @ torch.from_numpy(right)).numpy()


OffsetCodec: TypeAlias = Codec | PcaCodec


def reconstruction_r2(
    codec: OffsetCodec, offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> float:
    """R2 = 1 - sum |x~ - x|^2 / sum |x|^2 over `frames`, in metres; it is 0 for SMPL alone."""
    error = energy = 0.0
    for part in chunks(offsets_m, frames):
        rebuilt = codec.decode(codec.encode(part))
        error += float(np.square(rebuilt - part, dtype=np.float64).sum())
        energy += float(np.square(part, dtype=np.float64).sum())
    return 1 - error / energy if energy else float("nan")


def load_codec(artifact: Artifact) -> Codec:
    """The autoencoder of a finished `train-ae`."""
    return read_codec(artifact.file(weights_file(AUTOENCODER)), artifact.manifest["architecture"])


def load_codecs(artifact: Artifact) -> dict[CodeName, OffsetCodec]:
    """Every code of a finished `train-ae`."""
    codecs: dict[CodeName, OffsetCodec] = {AUTOENCODER: load_codec(artifact)}
    for code in LITERAL_CODES:
        if (name := weights_file(code)) in artifact.manifest["files"]:
            codecs[code] = read_codec(artifact.file(name), artifact.manifest["architecture"])
    for code, name in LINEAR_FILES.items():
        if name in artifact.manifest["files"]:
            path = artifact.file(name)
            arrays = load_weights(path)
            has_both = set(arrays) == {"mean_m", "components"}
            if not has_both or arrays["components"].shape[1:] != (arrays["mean_m"].size,):
                raise DsnetError(
                    f"{path} with {', '.join(sorted(arrays)) or 'no arrays'}",
                    "mean_m (V, 3) and components (K, V * 3)",
                    "Delete the folder and run `dsnet train-ae` again.",
                )
            codecs[code] = PcaCodec(arrays["mean_m"], arrays["components"])
    return codecs


def read_codec(path: Path, architecture: Mapping[str, Any]) -> Codec:
    """Load a codec from its weights and `Codec.architecture`'s values."""
    codec, weights = Codec.empty(architecture), load_weights(path)
    shapes = {name: tuple(value.shape) for name, value in codec.state_dict().items()}
    remedy = "Delete the folder and run `dsnet train-ae` again."
    check_shapes(weights, shapes, f"the network's in {path.parent}", remedy)
    state = {name: torch.from_numpy(value) for name, value in weights.items()}
    codec.load_state_dict(state, assign=True)
    return codec.eval()
