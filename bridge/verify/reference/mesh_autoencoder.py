"""The mesh autoencoder (Section 4.1, Figure 3): each layer's output, and its gradient.

The network is a chain, so both directions are one loop over its list of layers. A layer acts on
the last axis, or mixes vertices if it is a convolution; a nonlinearity follows all but the two
that end encoder and decoder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bridge.exchange.layouts import TORCH_ADAM
from bridge.paper import FEATURES
from bridge.verify.engine import Tensors, prefixed
from bridge.verify.reference import layers
from bridge.verify.reference.dsnet import Pass, train
from bridge.verify.reference.layers import Arrays

_WITHOUT_NONLINEARITY = ("to_latent", "to_coordinates")
Architecture = Mapping[str, Any]
"""With the nonlinearity's name, `activation`, and the `negative_slope` of `leaky_relu`."""


class Chain(NamedTuple):
    """What running the chain leaves."""

    outputs: Arrays
    """By layer, before its nonlinearity; after it as `<layer>_activation`."""
    inputs: Arrays
    """By layer."""
    slopes: Arrays
    """Of the nonlinearity, by layer that has one."""


def layers_of(w: Arrays) -> list[str]:
    """Names of all layers, first to last."""
    numbers = range(1, 1 + sum(name.startswith("encoder.conv_") for name in w) // 2)
    encoder, decoder = ([f"{side}.conv_{k}" for k in numbers] for side in ("encoder", "decoder"))
    return [
        "encoder.linear_1", "encoder.linear_2", *encoder, "to_latent",
        "from_latent", *decoder, "decoder.linear_1", "to_coordinates",
    ]  # fmt: skip


def forward(
    w: Arrays, values: np.ndarray, architecture: Architecture, names: Sequence[str] = ()
) -> Chain:
    """Every layer's output for values (B, V, 3), or of some consecutive layers for their input."""
    chain, features = Chain({}, {}, {}), values
    for name in names or layers_of(w):
        if name == "to_latent":  # about the latents the features of all vertices are one long row
            features = features.reshape(len(features), -1)
        elif name == "decoder.conv_1":
            features = features.reshape(len(features), -1, FEATURES[-1])
        chain.inputs[name] = features
        weight, bias = w[f"{name}.weight"], w[f"{name}.bias"]
        if ".conv_" in name:
            features = layers.vertex_mix(features, weight, bias)
        else:
            features = layers.dense(features, weight.T, bias)
        chain.outputs[name] = features
        if name not in _WITHOUT_NONLINEARITY:
            features, chain.slopes[name] = layers.activate(
                architecture["activation"], features, architecture["negative_slope"]
            )
            chain.outputs[f"{name}_activation"] = features
    return chain


def decode(w: Arrays, latents: np.ndarray, architecture: Architecture) -> np.ndarray:
    """Offsets (B, V, 3) of latents (B, 100), in metres by the normaliser among the weights."""
    names = layers_of(w)
    second_half = names[names.index("from_latent") :]
    values = forward(w, latents, architecture, second_half).outputs["to_coordinates"]
    return values * w["normaliser.scale_m"] + w["normaliser.mean_m"]


def learn(w: Arrays, values: np.ndarray, target: np.ndarray, architecture: Architecture) -> Pass:
    """Loss between what becomes of values (B, V, 3) and a target, and all of its gradients.

    In training the target is the values themselves.
    """
    chain = forward(w, values, architecture)
    loss, dy = layers.mean_squared_error(target, chain.outputs["to_coordinates"])
    gradients: Arrays = {}
    for name in reversed(layers_of(w)):
        dy = dy.reshape(chain.outputs[name].shape) * chain.slopes.get(name, 1.0)
        given, weight = chain.inputs[name], w[f"{name}.weight"]
        if ".conv_" in name:
            dy, by_weight, by_bias = layers.vertex_mix_backward(dy, given, weight)
        else:
            dy, by_kernel, by_bias = layers.dense_backward(dy, given, weight.T)
            by_weight = by_kernel.T
        gradients[f"{name}.weight"], gradients[f"{name}.bias"] = by_weight, by_bias
    return Pass(loss, gradients, {}, chain.outputs)


def ae_forward(w: Arrays, values: np.ndarray, architecture: Architecture, run: str) -> Tensors:
    """Every layer; from metres to metres where the weights hold the normaliser."""
    del run  # rows do not know of each other
    if "normaliser.mean_m" not in w:
        return prefixed("layer", forward(w, values, architecture).outputs)
    mean_m, scale_m = w["normaliser.mean_m"], w["normaliser.scale_m"]
    normalised = (values - mean_m) / scale_m
    outputs = forward(w, normalised, architecture).outputs
    last = outputs["to_coordinates"] * scale_m + mean_m
    return prefixed(
        "layer",
        {"normaliser.normalise": normalised, **outputs, "normaliser.denormalise": last},
    )


def ae_train(
    w: Arrays,
    values: np.ndarray,
    architecture: Architecture,
    steps: list[int],
    target: np.ndarray | None = None,
) -> Tensors:
    """Loss, gradients, steps of Adam."""
    wanted = values if target is None else target
    return train(w, lambda now: learn(now, values, wanted, architecture), TORCH_ADAM, steps)
