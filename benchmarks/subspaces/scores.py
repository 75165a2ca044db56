"""What is measured of a finished code: errors on frames it was not fitted to, and its speed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.subspaces.codes import OffsetAutoencoder
from benchmarks.subspaces.data import SubspaceData
from bridge.motion.splits import chunks
from dsnet.evaluation.metrics import FRAMES_AT_ONCE, ErrorSums
from torch_align_ae.autoencoder.codes import Normaliser, PcaCodec

_BATCHES = (1, 64)
_REPEATS = 30
OffsetCodec: TypeAlias = "NetworkCodec | PcaCodec"


@dataclass(frozen=True)
class NetworkCodec:
    """Encoder and decoder of a network on NumPy arrays, one batch at a time."""

    model: OffsetAutoencoder
    normaliser: Normaliser

    @property
    def latent_size(self) -> int:
        """n."""
        return self.model.latent_size

    def encode(self, offsets_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Offsets (B, V, 3) in metres to latents (B, n)."""
        return self._applied(lambda x: self.model.encode(self.normaliser.normalise(x)), offsets_m)

    def decode(self, latents: NDArray[np.float32]) -> NDArray[np.float32]:
        """Latents (B, n) to offsets (B, V, 3) in metres."""
        return self._applied(lambda z: self.normaliser.denormalise(self.model.decode(z)), latents)

    def to_processor(self) -> None:
        """Leave the GPU, if it was on one."""
        self.model.cpu()
        self.normaliser.cpu()

    @torch.inference_mode()
    def _applied(
        self, function: Callable[[Tensor], Tensor], values: NDArray
    ) -> NDArray[np.float32]:
        batch = torch.from_numpy(np.ascontiguousarray(values))
        return function(batch.to(self.normaliser.mean_m.device)).cpu().numpy()


def measured(codec: OffsetCodec, data: SubspaceData) -> dict[str, Any]:
    """Errors on both kinds of frames, in millimetres, and the processor's milliseconds to decode a
    batch."""
    held_out = errors(codec, data.offsets_m, data.held_out) if len(data.held_out) else None
    validation = errors(codec, data.offsets_m, data.split.validation)
    if isinstance(codec, NetworkCodec):
        codec.to_processor()
    return {
        "validation": validation,
        "held_out": held_out,
        "decode_ms": decode_ms(codec, data),
        "threads": torch.get_num_threads(),
    }


def errors(
    codec: OffsetCodec, offsets_m: NDArray[np.float32], frames: NDArray[np.int64]
) -> dict[str, float]:
    """R2, and mean, root mean square, 95 % and largest distance of what a code gives back."""
    sums = ErrorSums()
    for part in chunks(offsets_m, frames, FRAMES_AT_ONCE):
        sums.add(codec.decode(codec.encode(part)), part)
    return sums.summary()


def decode_ms(codec: OffsetCodec, data: SubspaceData) -> dict[str, float]:
    """Median milliseconds from latents to offsets in metres, by frames in a batch."""
    frames = np.resize(data.split.validation, max(_BATCHES))
    latents = codec.encode(np.asarray(data.offsets_m[frames]))
    return {str(size): _median_ms(lambda z: codec.decode(z), latents[:size]) for size in _BATCHES}


def _median_ms(function: Callable[[NDArray], Any], values: NDArray) -> float:
    taken_s = []
    for _ in range(_REPEATS):
        started = time.perf_counter()
        function(values)
        taken_s.append(time.perf_counter() - started)
    return 1e3 * median(taken_s)
