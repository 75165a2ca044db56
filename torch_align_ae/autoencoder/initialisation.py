"""How the mesh autoencoder's weights begin: in a few hundred steps this decides what is learned.

`torch` is PyTorch's own default, which the paper presumably used. Each of its
layers shrinks the signal (gain 1/sqrt(3) or less), so that fourteen of them
begin by answering zero, and most of a short run is spent on growing them.

`modes` begins as an exactly linear code that already reconstructs most of the
motion. Two facts make it. First, for f = LeakyReLU of slope a,

    f(-f(x)) = -a x        for every x,

so that a *pair* of layers, joined by minus the identity, is linear although
both nonlinearities are in place; the encoder has six activations and the
decoder six, hence three pairs each. Second, a linear code that mixes vertices
alike for all features is best made of the leading left singular vectors of
the vertices x (frames, coordinates) matrix. The latents begin as a random
rotation of those modes' coefficients, scaled to order one: distances between
latents then are distances between offsets, and no latent outweighs another.
"""

from __future__ import annotations

from typing import Any, Literal

import torch
from torch import Tensor

from bridge.paper import FEATURES
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder

InitialisationName = Literal["torch", "modes"]
SAMPLE_FRAMES = 512
"""Training frames from which the modes are computed: singular vectors of 6890 x 1536."""


@torch.no_grad()
def initialise_with_modes(model: MeshAutoencoder, sample: Tensor, seed: int) -> None:
    """Make `model` the best linear code of `sample` that mixes vertices alike for all features.

    Parameters
    ----------
    model : MeshAutoencoder
        With `leaky_relu`, whose pairs can be linear, and four convolutions.
    sample : Tensor
        (frames, V, 3) normalised offsets of training frames.
    seed : int
        Of the random directions that complete the modes, and of the latent rotation.
    """
    if model.activation != "leaky_relu" or len(model.widths) != 5:
        raise ValueError("'modes' needs leaky_relu, whose pairs are linear, and four convolutions")
    generator = torch.Generator().manual_seed(seed)
    _vertices, fine, middle, coarse, coarsest = model.widths
    basis = vertex_basis(sample, count=coarsest, size=fine, generator=generator)
    modes = torch.einsum("bvc,vm->bmc", sample, basis[:, :coarsest])
    code = _latent_code(modes, model.latent_size, generator)
    gain = model.negative_slope**-0.5
    encoder, decoder = model.encoder, model.decoder

    _set(encoder.linear_1, gain * _features(generator, FEATURES[1], FEATURES[0]))
    _set(encoder.linear_2, -gain * _features(generator, FEATURES[2], FEATURES[1]))
    _set(encoder.conv_1, gain * basis.T)
    _set(encoder.conv_2, -gain * torch.eye(middle, fine))
    _set(encoder.conv_3, gain * torch.eye(coarse, middle))
    _set(encoder.conv_4, -gain * torch.eye(coarsest, coarse))
    _set(model.to_latent, code)

    _set(model.from_latent, gain * _with_features(code.T, coarsest, generator))
    _set(decoder.conv_1, -gain * torch.eye(coarse, coarsest))
    _set(decoder.conv_2, gain * torch.eye(middle, coarse))
    _set(decoder.conv_3, -gain * torch.eye(fine, middle))
    _set(decoder.conv_4, gain * basis)
    _set(decoder.linear_1, -gain * torch.eye(FEATURES[1], FEATURES[2]))
    _set(model.to_coordinates, torch.eye(FEATURES[0], FEATURES[1]))
    _scale_latents(model, sample)


def _scale_latents(model: MeshAutoencoder, sample: Tensor) -> None:
    """Give the latents a root mean square of one, the scale that a predictor learns best."""
    latents = torch.cat([model.encode(part) for part in sample.split(64)])
    scale = latents.square().mean().sqrt().clamp(min=1e-6)
    model.to_latent.weight /= scale
    model.from_latent.weight *= scale


def vertex_basis(sample: Tensor, *, count: int, size: int, generator: torch.Generator) -> Tensor:
    """Orthonormal columns (V, size): the `count` leading vertex modes, then random directions."""
    snapshots = sample.transpose(0, 1).flatten(1)  # (V, frames * 3)
    gram = snapshots.T.double() @ snapshots.double()
    _, vectors = torch.linalg.eigh(gram)
    modes = snapshots.double() @ vectors.flip(1)[:, :count]
    others = torch.randn(len(snapshots), size - modes.shape[1], generator=generator)
    return torch.linalg.qr(torch.cat([modes.float(), others], dim=1)).Q


def _set(layer: Any, weight: Tensor) -> None:
    layer.weight.copy_(weight.reshape(layer.weight.shape))
    layer.bias.zero_()


def _features(generator: torch.Generator, rows: int, columns: int) -> Tensor:
    """Identity, and below it random features, which nothing reads at first but training may."""
    extra = torch.randn(rows - columns, columns, generator=generator) / columns**0.5
    return torch.cat([torch.eye(columns), extra])


def _latent_code(modes: Tensor, size: int, generator: torch.Generator) -> Tensor:
    """(size, M * 9): rotated latents of the linear features; the rest see the random ones.

    Where there are fewer latents than linear features, which are the modes' coefficients
    (frames, M, 3), their leading principal directions have them. Were the spare latents and the
    spare features zero on both sides, no gradient would ever reach them; hence their small random
    weights.
    """
    _, vertices, coordinates = modes.shape
    linear = min(vertices * coordinates, size)
    code = torch.zeros(size, vertices, FEATURES[-1])
    picked = _directions(modes.flatten(1), linear)
    code[:linear, :, :coordinates] = picked.view(linear, vertices, coordinates)
    spare = code[linear:, :, coordinates:]
    spare.copy_(torch.randn(spare.shape, generator=generator) / spare[0:1].numel() ** 0.5)
    square = torch.randn(size, size, generator=generator)
    return torch.linalg.qr(square).Q @ code.flatten(1)


def _directions(values: Tensor, count: int) -> Tensor:
    """(count, n): orthonormal rows that keep most of the energy of values (frames, n)."""
    if count == values.shape[1]:
        return torch.eye(count)
    values = values.double()
    return torch.linalg.eigh(values.T @ values)[1].flip(1)[:, :count].T.float()


def _with_features(weight: Tensor, vertices: int, generator: torch.Generator) -> Tensor:
    """The decoder's first weight (vertices * 9, n), in which no spare feature is zero.

    Where no latent was spare they would all be, and so learn one and the same. Nothing reads them
    at first: the code stays linear.
    """
    weight = weight.clone().view(vertices, FEATURES[-1], -1)
    spare = weight[:, FEATURES[0] :]
    if not spare.any():
        spare.copy_(torch.randn(spare.shape, generator=generator) / weight.shape[-1] ** 0.5)
    return weight.flatten(0, 1)
