"""DSNet and the mesh autoencoder's decoder tick by tick, for several persons at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.trained_dsnet import TrainedDsnet
from bridge.runtime.streams.streaming import SteppedDsnet


@dataclass(frozen=True, eq=False)
class LatentPast:
    """What the network remembers."""

    betas: NDArray
    memory: NDArray[np.float32]
    """(2, 60) the LSTM's cells and hidden state."""


class StreamingLatents:
    """A `StreamingModel` whose codes are latents (100,).

    Parameters
    ----------
    network : a trained DSNet.
    decode : latents (B, 100) to offsets (B, V, 3), metres.
    """

    look_ahead = 0

    def __init__(self, network: TrainedDsnet, decode: Callable[[NDArray], NDArray]) -> None:
        self._network, self._decode = SteppedDsnet(network), decode

    def join(self, betas: NDArray) -> NDArray:
        """The shape itself."""
        return betas

    def begin(self, person: NDArray, theta: NDArray) -> tuple[LatentPast, NDArray]:
        """Remembers nothing."""
        return self._stepped([person], theta[None], None)[0]

    def advance(
        self, pasts: Sequence[LatentPast], theta: NDArray
    ) -> list[tuple[LatentPast, NDArray | None]]:
        """One step of the network for all."""
        memory = np.stack([past.memory for past in pasts], axis=1)
        return [*self._stepped([past.betas for past in pasts], theta, memory)]

    def finish(self, past: LatentPast) -> list[NDArray]:
        """Nothing is owed."""
        return []

    def offsets_m(
        self, people: Sequence[NDArray], codes: Sequence[NDArray], theta: NDArray
    ) -> NDArray[np.float32]:
        """Decoded."""
        return self._decode(np.stack(codes))

    def latents(self, code: NDArray) -> NDArray:
        """The code itself."""
        return code.copy()

    def _stepped(
        self, betas: Sequence[NDArray], theta: NDArray, memory: NDArray | None
    ) -> list[tuple[LatentPast, NDArray]]:
        self._network.recall(memory)
        latents = self._network.step(np.concatenate((betas, theta), axis=1, dtype=np.float32))
        remembered = self._network.remembered()
        return [
            (LatentPast(shape, remembered[:, row].copy()), latents[row])
            for row, shape in enumerate(betas)
        ]
