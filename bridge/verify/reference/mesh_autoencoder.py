"""The mesh autoencoder (Section 4.1, Figure 3): each layer's output, and its gradient.

The network is a chain, so both directions are one loop over its list of layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bridge.paper import FEATURES
from bridge.verify.reference import layers
from bridge.verify.reference.activations import activate, slope
from bridge.verify.reference.adam import Arrays, Pass
from bridge.verify.reference.losses import mean_squared_error


@dataclass(frozen=True)
class Layer:
    """One link of the chain."""

    name: str
    """As in the weights' names."""
    kind: Literal["linear", "conv"]
    """Acts on the last axis, or mixes vertices."""
    activated: bool
    """Whether the nonlinearity follows."""


@dataclass(frozen=True)
class Architecture:
    """What besides weights decides what the network computes."""

    convolutions: int
    """In the encoder, and again in the decoder."""
    activation: str
    """Name of the nonlinearity."""
    negative_slope: float
    """Of `leaky_relu` below zero."""

    @property
    def chain(self) -> tuple[Layer, ...]:
        """All layers, first to last."""
        numbers = range(1, self.convolutions + 1)
        return (
            Layer("encoder.linear_1", "linear", True),
            Layer("encoder.linear_2", "linear", True),
            *(Layer(f"encoder.conv_{k}", "conv", True) for k in numbers),
            Layer("to_latent", "linear", False),
            Layer("from_latent", "linear", True),
            *(Layer(f"decoder.conv_{k}", "conv", True) for k in numbers),
            Layer("decoder.linear_1", "linear", True),
            Layer("to_coordinates", "linear", False),
        )


def run(weights: Arrays, values: np.ndarray, architecture: Architecture) -> Arrays:
    """Every layer's output, before and after its nonlinearity, for values (B, V, 3)."""
    outputs, _given = _forward(weights, values, architecture.chain, architecture)
    return outputs


def decode(weights: Arrays, latents: np.ndarray, architecture: Architecture) -> np.ndarray:
    """Normalised offsets (B, V, 3) of latents (B, 100)."""
    chain = architecture.chain
    second_half = chain[[layer.name for layer in chain].index("from_latent") :]
    return _forward(weights, latents, second_half, architecture)[0]["to_coordinates"]


def learn(
    weights: Arrays, values: np.ndarray, target: np.ndarray, architecture: Architecture
) -> Pass:
    """Loss between what becomes of values (B, V, 3) and a target, and all of its gradients.

    In training the target is the values themselves.
    """
    outputs, given = _forward(weights, values, architecture.chain, architecture)
    loss, dy = mean_squared_error(target, outputs["to_coordinates"])
    gradients: Arrays = {}
    for layer in reversed(architecture.chain):
        z = outputs[layer.name]
        dy = dy.reshape(z.shape)
        if layer.activated:
            dy = dy * slope(architecture.activation, z, architecture.negative_slope)
        dy, by_weight, by_bias = _backward(layer, dy, given[layer.name], weights)
        gradients[f"{layer.name}.weight"], gradients[f"{layer.name}.bias"] = by_weight, by_bias
    return Pass(loss, gradients, {})


def _forward(
    w: Arrays, values: np.ndarray, chain: Sequence[Layer], architecture: Architecture
) -> tuple[Arrays, Arrays]:
    """Outputs by name (activated ones as `<layer>_activation`), and each layer's own input."""
    outputs: Arrays = {}
    given: Arrays = {}
    features = values
    for layer in chain:
        given[layer.name] = features = _as_input_of(layer, features)
        weight, bias = w[f"{layer.name}.weight"], w[f"{layer.name}.bias"]
        if layer.kind == "linear":
            features = layers.dense(features, weight.T, bias)
        else:
            features = layers.vertex_mix(features, weight, bias)
        outputs[layer.name] = features
        if layer.activated:
            features = activate(architecture.activation, features, architecture.negative_slope)
            outputs[f"{layer.name}_activation"] = features
    return outputs, given


def _as_input_of(layer: Layer, features: np.ndarray) -> np.ndarray:
    """Around the latent vector the features of all vertices are one long row."""
    if layer.name == "to_latent":
        return features.reshape(len(features), -1)
    if layer.name == "decoder.conv_1":
        return features.reshape(len(features), -1, FEATURES[-1])
    return features


def _backward(
    layer: Layer, dy: np.ndarray, x: np.ndarray, w: Arrays
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    weight = w[f"{layer.name}.weight"]
    if layer.kind == "conv":
        return layers.vertex_mix_backward(dy, x, weight)
    by_x, by_kernel, by_bias = layers.dense_backward(dy, x, weight.T)
    return by_x, by_kernel.T, by_bias
