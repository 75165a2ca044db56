"""The fully connected autoencoder to which the paper compares its own (Casas and Otaduy 2018;
Section 5)."""

from __future__ import annotations

from itertools import pairwise

from torch import Tensor, nn

from bridge.paper import CASAS_OTADUY_WIDTHS, LATENT_SIZE


class CasasOtaduyAutoencoder(nn.Module):
    """A fully connected autoencoder of flattened offsets, with 284,678,770 parameters.

    `widths` are the input size and the outputs of the encoder's layers but the last.
    """

    def __init__(
        self,
        widths: tuple[int, ...] = CASAS_OTADUY_WIDTHS[:-1],
        latent_size: int = LATENT_SIZE,
    ) -> None:
        super().__init__()
        self.latent_size = latent_size
        widths = (*widths, latent_size)
        self.encoder = _fully_connected(widths)
        self.decoder = _fully_connected(widths[::-1])

    def encode(self, offsets: Tensor) -> Tensor:
        """Normalised offsets (B, V, 3) to latents (B, n)."""
        return self.encoder(offsets.flatten(1))

    def decode(self, latents: Tensor) -> Tensor:
        """Latents (B, n) to normalised offsets (B, V, 3)."""
        return self.decoder(latents).unflatten(1, (-1, 3))

    def forward(self, offsets: Tensor) -> Tensor:
        return self.decode(self.encode(offsets))


def _fully_connected(widths: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width_in, width_out in pairwise(widths):
        layers += [nn.Linear(width_in, width_out), nn.LeakyReLU(0.1, inplace=True)]
    return nn.Sequential(*layers[:-1])
