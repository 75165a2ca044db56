"""Figure 3's autoencoder: from the offsets of 6890 vertices to 100 latents and back.

Two linear layers act on each vertex alone (3 -> 4 -> 9 features), four
convolutions of kernel 1 treat the *vertices* as channels and thin them out,
and one linear layer maps what is left to the latent vector; the decoder
mirrors it. The paper prints the layers and the total, 33,626,606, but not the
widths: those here are inferred, and give that total exactly.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn

from bridge.errors import DsnetError
from bridge.paper import FEATURES, INFERRED_WIDTHS, LATENT_SIZE

ActivationName = Literal["leaky_relu", "elu", "tanh", "relu"]

_ACTIVATIONS: dict[str, Callable[[float], nn.Module]] = {
    "leaky_relu": lambda slope: nn.LeakyReLU(slope, inplace=True),
    "elu": lambda slope: nn.ELU(),
    "tanh": lambda slope: nn.Tanh(),
    "relu": lambda slope: nn.ReLU(inplace=True),
}


class VertexConv(nn.Conv1d):
    """A kernel-1 `Conv1d` over vertices, applied to vertices-first features.

    The parameters are those of `nn.Conv1d(in, out, 1)`, but the features come as
    (in, B, C) where Conv1d wants (B, in, C): so laid out, the whole batch is one
    matrix product, forwards and backwards, and nothing is transposed on the way.
    """

    def __init__(self, in_vertices: int, out_vertices: int) -> None:
        super().__init__(in_vertices, out_vertices, kernel_size=1)

    def forward(self, input: Tensor) -> Tensor:  # noqa: A002
        """Mix (in, B, C) into (out, B, C)."""
        assert self.bias is not None
        mixed = torch.addmm(self.bias[:, None], self.weight.squeeze(2), input.flatten(1))
        return mixed.view(self.out_channels, *input.shape[1:])


class MeshAutoencoder(nn.Module):
    """The paper's mesh autoencoder (Section 4.1, Figure 3); works on normalised offsets.

    Parameters
    ----------
    widths : tuple of int
        Vertices of the mesh, then after each convolution; see `INFERRED_WIDTHS`.
    activation : str
        Nonlinearity after every layer but the two that end encoder and decoder.
        The paper does not name it.
    negative_slope : float
        Slope of `leaky_relu` below zero.
    latent_size : int
        Numbers kept of a mesh, n; the paper's is 100.
    """

    def __init__(
        self,
        widths: tuple[int, ...] = INFERRED_WIDTHS,
        activation: ActivationName = "leaky_relu",
        negative_slope: float = 0.1,
        latent_size: int = LATENT_SIZE,
    ) -> None:
        super().__init__()
        self.widths, self.activation, self.negative_slope = widths, activation, negative_slope
        self.latent_size = latent_size
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
        self.activate = _ACTIVATIONS[activation](negative_slope)

    def _stack(self, *layers: tuple[str, nn.Module]) -> nn.Sequential:
        activation = _ACTIVATIONS[self.activation](self.negative_slope)
        steps: OrderedDict[str, nn.Module] = OrderedDict()
        for name, layer in layers:
            steps[name] = layer
            steps[f"{name}_activation"] = activation
        return nn.Sequential(steps)

    def encode(self, offsets: Tensor) -> Tensor:
        """Normalised offsets (B, V, 3) to latents (B, n).

        Raises
        ------
        DsnetError
            If the mesh has another number of vertices than the network.
        """
        self._check(offsets)
        coarse = self.encoder(offsets.transpose(0, 1).contiguous())  # (30, B, 9)
        return self.to_latent(coarse.transpose(0, 1).flatten(1))

    def decode(self, latents: Tensor) -> Tensor:
        """Latents (B, n) to normalised offsets (B, V, 3)."""
        coarse = self.activate(self.from_latent(latents))  # (B, 270)
        coarse = coarse.view(-1, self.widths[-1], FEATURES[-1]).transpose(0, 1).contiguous()
        return self.to_coordinates(self.decoder(coarse)).transpose(0, 1)

    def forward(self, offsets: Tensor) -> Tensor:
        """Reconstruct normalised offsets (B, V, 3)."""
        return self.decode(self.encode(offsets))

    def _check(self, offsets: Tensor) -> None:
        if offsets.ndim != 3 or offsets.shape[1:] != (self.widths[0], FEATURES[0]):
            raise DsnetError(
                f"offsets of shape {tuple(offsets.shape)}",
                f"(frames, {self.widths[0]}, {FEATURES[0]})",
                "Use meshes with the topology that the autoencoder was trained on.",
            )


def _convolutions(widths: tuple[int, ...]) -> list[tuple[str, nn.Module]]:
    return [(f"conv_{k}", VertexConv(*pair)) for k, pair in enumerate(pairwise(widths), start=1)]


def parameter_count(model: nn.Module) -> int:
    """Number of trainable parameters of a built model."""
    return sum(parameter.numel() for parameter in model.parameters() if parameter.requires_grad)
