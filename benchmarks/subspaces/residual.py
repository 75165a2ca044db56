"""A residual autoencoder that begins as PCA, after SoftSMPL (Santesteban et al. 2020).

That paper's code is fully connected, has "several residual units", and its first and last layers
start from PCA. Its widths are not known: all numbers here are ours.

    offsets -> PCA -> residual units -> latents -> residual units -> PCA's transpose -> offsets

The first layer keeps more components than there are latents, so that a unit may bend what PCA of
the latents' size throws away into what it keeps. Each unit's last layer begins at zero and the
latents as the leading components: before the first step this is PCA of the latents' size.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from bridge.paper import LATENT_SIZE, N_VERTICES
from torch_align_ae.autoencoder.codes import Normaliser, PcaCodec

RESIDUAL_WIDTH = 300
"""Principal components between the outer layers and the latents; ours."""
RESIDUAL_UNITS = 2
"""Residual units of the encoder, and of the decoder; ours."""


class ResidualUnit(nn.Module):
    """x + W2 f(W1 x): the identity as long as W2 is zero, which it is at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.fc_1 = nn.Linear(width, width)
        self.activation = nn.LeakyReLU(0.1)
        self.fc_2 = nn.Linear(width, width)
        nn.init.zeros_(self.fc_2.weight)
        nn.init.zeros_(self.fc_2.bias)

    def forward(self, features: Tensor) -> Tensor:
        """(B, width) to (B, width)."""
        return features + self.fc_2(self.activation(self.fc_1(features)))


class ResidualAutoencoder(nn.Module):
    """Fully connected autoencoder of flattened offsets with residual units.

    Parameters
    ----------
    vertices : int
        V of the meshes.
    latent_size : int
        Numbers kept of a mesh, n.
    width : int
        Features of every unit, at least `latent_size`.
    units : int
        Residual units of the encoder, and of the decoder.
    """

    def __init__(
        self,
        vertices: int = N_VERTICES,
        latent_size: int = LATENT_SIZE,
        width: int = RESIDUAL_WIDTH,
        units: int = RESIDUAL_UNITS,
    ) -> None:
        super().__init__()
        if width < latent_size:
            raise ValueError(f"{latent_size} latents of {width} features")
        self.latent_size = latent_size
        self.from_offsets = nn.Linear(3 * vertices, width)
        self.encoder = nn.Sequential(*(ResidualUnit(width) for _ in range(units)))
        self.to_latent = nn.Linear(width, latent_size)
        self.from_latent = nn.Linear(latent_size, width)
        self.decoder = nn.Sequential(*(ResidualUnit(width) for _ in range(units)))
        self.to_offsets = nn.Linear(width, 3 * vertices)

    def encode(self, offsets: Tensor) -> Tensor:
        """Normalised offsets (B, V, 3) to latents (B, n)."""
        return self.to_latent(self.encoder(self.from_offsets(offsets.flatten(1))))

    def decode(self, latents: Tensor) -> Tensor:
        """Latents (B, n) to normalised offsets (B, V, 3)."""
        return self.to_offsets(self.decoder(self.from_latent(latents))).unflatten(1, (-1, 3))

    def forward(self, offsets: Tensor) -> Tensor:
        """Reconstruct normalised offsets (B, V, 3)."""
        return self.decode(self.encode(offsets))


@torch.no_grad()
def initialise_with_pca(model: ResidualAutoencoder, pca: PcaCodec, normaliser: Normaliser) -> None:
    """Make `model` equal to PCA with as many components as it has latents.

    Parameters
    ----------
    model : ResidualAutoencoder
        Newly built, so that its units are the identity.
    pca : PcaCodec
        As many components as the model's units have features.
    normaliser : Normaliser
        Of the offsets that the model is given. Features are PCA's coefficients in units of its mean
        scale, so that under one scale for all coordinates the first layer is orthonormal.
    """
    components = torch.from_numpy(pca.components).double()  # (width, 3V)
    if components.shape != model.from_offsets.weight.shape:
        raise ValueError(f"components {tuple(components.shape)} for {model.from_offsets}")
    scale_m = normaliser.scale_m.flatten().double()
    unit_m = scale_m.mean()
    moved_m = (normaliser.mean_m.double() - torch.from_numpy(pca.mean_m)).flatten()
    model.from_offsets.weight.copy_(components * (scale_m / unit_m))
    model.from_offsets.bias.copy_(components @ moved_m / unit_m)
    model.to_offsets.weight.copy_((components * (unit_m / scale_m)).T)
    model.to_offsets.bias.copy_(-moved_m / scale_m)
    for layer in (model.to_latent, model.from_latent):
        nn.init.eye_(layer.weight)
        nn.init.zeros_(layer.bias)
