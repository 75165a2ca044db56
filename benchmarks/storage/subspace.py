"""Principal directions of a run's frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Subspace:
    """A mean and k directions, in float32 as they would be stored."""

    mean: NDArray[np.float32]
    """(V * 3,)."""
    directions: NDArray[np.float32]
    """(k, V * 3), orthonormal."""

    @classmethod
    def fitted(cls, frames: NDArray, count: int) -> Subspace:
        """To frames (n, V, 3): their mean and first `count` directions."""
        flat = np.asarray(frames, np.float64).reshape(len(frames), -1)
        mean = flat.mean(axis=0)
        apart = flat - mean
        # Of the few frames' products: the vertices are many more.
        variances, mixtures = np.linalg.eigh(apart @ apart.T)
        used = np.flatnonzero(variances > 1e-9 * variances[-1])[::-1][:count]
        directions = (mixtures[:, used] / np.sqrt(variances[used])).T @ apart
        return cls(mean.astype(np.float32), directions.astype(np.float32))

    @property
    def size_bytes(self) -> int:
        """Of both arrays."""
        return self.mean.nbytes + self.directions.nbytes

    def coefficients(self, frames: NDArray) -> NDArray[np.float32]:
        """(n, k) of frames (n, V, 3)."""
        flat = frames.reshape(len(frames), -1)
        return ((flat - self.mean) @ self.directions.T).astype(np.float32)

    def frames(self, coefficients: NDArray, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Frames (n, V, 3) of coefficients (n, k)."""
        return (coefficients @ self.directions + self.mean).reshape(shape)
