"""The mesh autoencoder of Figure 3, and the initialisation of its weights.

Two linear layers act on each vertex alone (3 -> 4 -> 9 features), four convolutions of kernel size
1 with the *vertices* as channels reduce their number, and one linear layer maps the result to the
latent vector; the decoder mirrors it. The paper states the layers and the number of parameters,
33,626,606, but not the widths: those here are inferred, and give that number exactly.
"""

from __future__ import annotations

from collections import OrderedDict
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from bridge.errors import DsnetError
from bridge.paper import FEATURES, INFERRED_WIDTHS, LATENT_SIZE, NEGATIVE_SLOPE

SAMPLE_FRAMES = 512
"""Training frames from which the modes are computed, singular vectors of 6890 x 1536."""


class VertexConv(nn.Conv1d):
    """A `Conv1d` of kernel size 1 over vertices, for features (in, B, C) in place of (B, in, C).

    With this layout the whole batch is one matrix product without transpositions.
    """

    def __init__(self, in_vertices: int, out_vertices: int) -> None:
        super().__init__(in_vertices, out_vertices, kernel_size=1)

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        assert self.bias is not None
        mixed = torch.addmm(self.bias[:, None], self.weight.squeeze(2), input.flatten(1))
        return mixed.view(self.out_channels, *input.shape[1:])


class MeshAutoencoder(nn.Module):
    """The paper's mesh autoencoder (Section 4.1, Figure 3); works on normalised offsets.

    `widths` are the numbers of vertices of the mesh and after each convolution. Every layer but the
    last of encoder and decoder is followed by LeakyReLU; the paper names no activation.
    """

    def __init__(
        self, widths: tuple[int, ...] = INFERRED_WIDTHS, latent_size: int = LATENT_SIZE
    ) -> None:
        super().__init__()
        self.widths, self.latent_size = widths, latent_size
        self.activate = nn.LeakyReLU(NEGATIVE_SLOPE, inplace=True)
        coarse = widths[-1] * FEATURES[-1]
        self.encoder = self._stack(
            ("linear_1", nn.Linear(FEATURES[0], FEATURES[1])),
            ("linear_2", nn.Linear(FEATURES[1], FEATURES[2])),
            *_convolutions(widths),
        )
        self.to_latent = nn.Linear(coarse, latent_size)
        self.from_latent = nn.Linear(latent_size, coarse)
        self.decoder = self._stack(
            *_convolutions(widths[::-1]),
            ("linear_1", nn.Linear(FEATURES[2], FEATURES[1])),
        )
        self.to_coordinates = nn.Linear(FEATURES[1], FEATURES[0])

    def _stack(self, *layers: tuple[str, nn.Module]) -> nn.Sequential:
        steps: OrderedDict[str, nn.Module] = OrderedDict()
        for name, layer in layers:
            steps[name] = layer
            steps[f"{name}_activation"] = self.activate
        return nn.Sequential(steps)

    def encode(self, offsets: Tensor) -> Tensor:
        """Normalised offsets (B, V, 3) to latents (B, n)."""
        if offsets.ndim != 3 or offsets.shape[1:] != (self.widths[0], FEATURES[0]):
            raise DsnetError(
                f"offsets of shape {tuple(offsets.shape)}",
                f"(frames, {self.widths[0]}, {FEATURES[0]})",
                "Use meshes with the topology that the autoencoder was trained on.",
            )
        coarse = self.encoder(offsets.transpose(0, 1).contiguous())  # (30, B, 9)
        return self.to_latent(coarse.transpose(0, 1).flatten(1))

    def decode(self, latents: Tensor) -> Tensor:
        """Latents (B, n) to normalised offsets (B, V, 3)."""
        coarse = self.activate(self.from_latent(latents))  # (B, 270)
        coarse = coarse.view(-1, self.widths[-1], FEATURES[-1]).transpose(0, 1).contiguous()
        return self.to_coordinates(self.decoder(coarse)).transpose(0, 1)

    def forward(self, offsets: Tensor) -> Tensor:
        return self.decode(self.encode(offsets))


def _convolutions(widths: tuple[int, ...]) -> list[tuple[str, nn.Module]]:
    return [(f"conv_{k}", VertexConv(*pair)) for k, pair in enumerate(pairwise(widths), start=1)]


def parameter_count(model: nn.Module) -> int:
    """The number of trainable parameters."""
    return sum(parameter.numel() for parameter in model.parameters() if parameter.requires_grad)


@torch.no_grad()
def initialise_with_modes(model: MeshAutoencoder, sample: Tensor, seed: int) -> None:
    """Initialise `model` as the best linear code of `sample` with the same modes for all features.

    PyTorch's default initialisation, which the paper presumably used, shrinks the signal by
    1/sqrt(3) or more in each layer: fourteen layers give zero, and a short training mostly grows
    the weights. This one is exactly linear and already reconstructs most of the motion.
    First, for f = LeakyReLU of slope a,

        f(-f(x)) = -a x        for every x,

    so that a *pair* of layers joined by minus the identity is linear in spite of both activations;
    encoder and decoder have six activations each, hence three pairs. Second, the best linear code
    with the same vertex modes for all features consists of the leading left singular vectors of the
    vertices x (frames, coordinates) matrix. The latents are a random rotation of these modes'
    coefficients, scaled to order one: distances between latents are then proportional to those
    between offsets, and no latent outweighs another.

    `sample` (frames, V, 3) are normalised offsets of training frames; `seed` decides the random
    directions that complete the modes, and the rotation.
    """
    generator = torch.Generator().manual_seed(seed)
    _vertices, fine, middle, coarse, coarsest = model.widths
    basis = vertex_basis(sample, count=coarsest, size=fine, generator=generator)
    modes = torch.einsum("bvc,vm->bmc", sample, basis[:, :coarsest])
    code = _latent_code(modes, model.latent_size, generator)
    gain = NEGATIVE_SLOPE**-0.5
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
    # A root mean square of one is the scale that a predictor learns best.
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
    """The identity, and below it random features, which only training connects."""
    extra = torch.randn(rows - columns, columns, generator=generator) / columns**0.5
    return torch.cat([torch.eye(columns), extra])


def _latent_code(modes: Tensor, size: int, generator: torch.Generator) -> Tensor:
    """The weight (size, M * 9) of the latent layer, by the coefficients (frames, M, 3) of modes.

    Latents are rotated linear features, the coefficients; if there are fewer latents, their leading
    principal directions. Spare latents get small random weights of spare features: if both were
    zero, no gradient would ever reach them.
    """
    _, vertices, coordinates = modes.shape
    linear = min(vertices * coordinates, size)
    code = torch.zeros(size, vertices, FEATURES[-1])
    picked = torch.eye(linear)
    if linear < vertices * coordinates:  # orthonormal rows that keep most of the energy
        values = modes.flatten(1).double()
        picked = torch.linalg.eigh(values.T @ values)[1].flip(1)[:, :linear].T.float()
    code[:linear, :, :coordinates] = picked.view(linear, vertices, coordinates)
    spare = code[linear:, :, coordinates:]
    spare.copy_(torch.randn(spare.shape, generator=generator) / spare[0:1].numel() ** 0.5)
    square = torch.randn(size, size, generator=generator)
    return torch.linalg.qr(square).Q @ code.flatten(1)


def _with_features(weight: Tensor, vertices: int, generator: torch.Generator) -> Tensor:
    """The decoder's first weight (vertices * 9, n) with random weights of spare features.

    If no latent was spare these would all be zero, and then learn the same. Later layers ignore
    them at first, so the code stays linear.
    """
    weight = weight.clone().view(vertices, FEATURES[-1], -1)
    spare = weight[:, FEATURES[0] :]
    if not spare.any():
        spare.copy_(torch.randn(spare.shape, generator=generator) / weight.shape[-1] ** 0.5)
    return weight.flatten(0, 1)
