"""How much of the offsets a codec keeps: R2 = 1 - sum |x~ - x|^2 / sum |x|^2, in raw metres."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.motion.splits import chunks


class OffsetCodec(Protocol):
    """Anything that turns offsets (B, V, 3) in metres into latents and back."""

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets to latents."""
        ...

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Latents to offsets."""
        ...


def reconstruction_r2(
    codec: OffsetCodec, offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> float:
    """R2 of decode(encode(x)) over the named frames; SMPL alone, offset zero, has 0."""
    error = energy = 0.0
    for part in chunks(offsets_m, frames):
        rebuilt = codec.decode(codec.encode(part))
        error += float(np.square(rebuilt - part, dtype=np.float64).sum())
        energy += float(np.square(part, dtype=np.float64).sum())
    return 1 - error / energy if energy else float("nan")
