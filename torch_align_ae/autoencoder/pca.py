"""How much of the offsets a codec keeps, and the linear code to compare the autoencoder with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from bridge.motion.splits import chunks

_SPARE_DIRECTIONS = 20


@dataclass(frozen=True)
class PcaCodec:
    """Mean and principal directions of offsets; encodes to coefficients in metres."""

    mean_m: NDArray[np.float32]
    """(V, 3)."""
    components: NDArray[np.float32]
    """(K, V * 3), orthonormal rows, in order of falling variance."""

    @classmethod
    def fit(
        cls,
        offsets_m: NDArray[np.float32],
        frames: NDArray[np.int64],
        size: int = 100,
        *,
        passes: int = 3,
        seed: int = 0,
    ) -> PcaCodec:
        """Fit `size` components to the named frames of (F, V, 3) without holding them in memory.

        Randomised subspace iteration (Halko, Martinsson, Tropp 2011): each pass
        streams the frames once and multiplies the subspace by their covariance.
        """
        total = np.zeros(offsets_m.shape[1:])
        for part in chunks(offsets_m, frames):
            total += part.sum(axis=0, dtype=np.float64)
        mean = (total / len(frames)).astype(np.float32)
        width = min(size + _SPARE_DIRECTIONS, mean.size)
        subspace = np.random.default_rng(seed).standard_normal((mean.size, width), np.float32)
        for _ in range(passes - 1):
            subspace, _inner = _covariance_times(_basis(subspace), offsets_m, frames, mean)
        basis = _basis(subspace)
        _subspace, inner = _covariance_times(basis, offsets_m, frames, mean)
        rotation = np.linalg.eigh(inner)[1][:, ::-1][:, :size]
        return cls(mean, np.ascontiguousarray((basis @ rotation.astype(np.float32)).T))

    @classmethod
    def of_directions(cls, directions: NDArray[np.floating]) -> PcaCodec:
        """The code of given directions (V, 3, K) about zero: they are made orthonormal in order."""
        columns = directions.reshape(-1, directions.shape[2]).astype(np.float64)
        basis, upper = np.linalg.qr(columns)
        components = (basis * np.where(np.diag(upper) < 0, -1.0, 1.0)).T.astype(np.float32)
        return cls(np.zeros(directions.shape[:2], np.float32), np.ascontiguousarray(components))

    @property
    def vertex_count(self) -> int:
        """V."""
        return len(self.mean_m)

    @property
    def latent_size(self) -> int:
        """K."""
        return len(self.components)

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """What a file holds."""
        return {"mean_m": self.mean_m, "components": self.components}

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets (B, V, 3) in metres to coefficients (B, K) in metres."""
        centred = np.asarray(offsets_m - self.mean_m, dtype=np.float32)
        return _product(centred.reshape(len(offsets_m), -1), self.components.T)

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Coefficients (B, K) to offsets (B, V, 3) in metres."""
        offsets_m = _product(latents, self.components).reshape(-1, *self.mean_m.shape)
        return offsets_m + self.mean_m


def _product(left: NDArray[np.float32], right: NDArray[np.float32]) -> NDArray[np.float32]:
    """PyTorch's, which obeys `torch_workers`: NumPy's bits depend on how many cores there are."""
    return (torch.tensor(left) @ torch.from_numpy(right)).numpy()


def _basis(subspace: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.linalg.qr(subspace)[0]


def _covariance_times(
    basis: NDArray[np.float32],
    offsets_m: NDArray[np.float32],
    frames: NDArray[np.int64],
    mean: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """(X'X) basis, and basis' (X'X) basis, of the centred frames X."""
    product = np.zeros_like(basis)
    inner = np.zeros((basis.shape[1],) * 2)
    for part in chunks(offsets_m, frames):
        centred = (part - mean).reshape(len(part), -1)
        coefficients = centred @ basis
        product += centred.T @ coefficients
        inner += np.float64(coefficients.T @ coefficients)
    return product, inner


class OffsetCodec(Protocol):
    """Anything that turns offsets (B, V, 3) in metres into latents and back."""

    @property
    def latent_size(self) -> int:
        """Numbers kept of a mesh."""
        ...

    @property
    def vertex_count(self) -> int:
        """V."""
        ...

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets to latents."""
        ...

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Latents to offsets."""
        ...


def reconstruction_r2(
    codec: OffsetCodec, offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> float:
    """R2 = 1 - sum |x~ - x|^2 / sum |x|^2 over the named frames, in metres; SMPL alone has 0."""
    error = energy = 0.0
    for part in chunks(offsets_m, frames):
        rebuilt = codec.decode(codec.encode(part))
        error += float(np.square(rebuilt - part, dtype=np.float64).sum())
        energy += float(np.square(part, dtype=np.float64).sum())
    return 1 - error / energy if energy else float("nan")
