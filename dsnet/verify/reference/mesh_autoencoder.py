"""The mesh autoencoder (Section 4.1, Figure 3), forward and backward.

The network is a chain of layers, so each direction is one loop. Linear layers act on features,
convolutions on vertices; a nonlinearity follows all but the last layer of encoder and decoder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bridge.exchange.engine import Tensors, prefixed
from bridge.exchange.weights import TORCH_ADAM
from bridge.paper import FEATURES
from dsnet.verify.reference import layers
from dsnet.verify.reference.dsnet import Pass, train
from dsnet.verify.reference.layers import Arrays

_WITHOUT_NONLINEARITY = ("to_latent", "to_coordinates")
Architecture = Mapping[str, Any]
"""From which other engines build their networks; the reference uses the shapes of the weights."""


class Chain(NamedTuple):
    """A forward pass through consecutive layers."""

    outputs: Arrays
    """By layer, before its nonlinearity; after it as `<layer>_activation`."""
    inputs: Arrays
    """By layer."""
    slopes: Arrays
    """Derivatives of the nonlinearity, by layer that has one."""


def layers_of(w: Arrays) -> list[str]:
    """Names of the layers in order, from the names of the weights."""
    numbers = range(1, 1 + sum(name.startswith("encoder.conv_") for name in w) // 2)
    encoder, decoder = ([f"{side}.conv_{k}" for k in numbers] for side in ("encoder", "decoder"))
    return [
        "encoder.linear_1", "encoder.linear_2", *encoder, "to_latent",
        "from_latent", *decoder, "decoder.linear_1", "to_coordinates",
    ]  # fmt: skip


def forward(w: Arrays, values: np.ndarray, names: Sequence[str] = ()) -> Chain:
    """Every layer's output for values (B, V, 3); or run only the layers in `names`."""
    chain, features = Chain({}, {}, {}), values
    for name in names or layers_of(w):
        if name == "to_latent":  # acts on the features of all vertices as one vector
            features = features.reshape(len(features), -1)
        elif name == "decoder.conv_1":
            features = features.reshape(len(features), -1, FEATURES[-1])
        chain.inputs[name] = layer_input = _swapped_for_conv(name, features)
        features = layers.dense(layer_input, _kernel(w, name), w[f"{name}.bias"])
        chain.outputs[name] = features = _swapped_for_conv(name, features)
        if name not in _WITHOUT_NONLINEARITY:
            features, chain.slopes[name] = layers.leaky_relu(features)
            chain.outputs[f"{name}_activation"] = features
    return chain


def _kernel(w: Arrays, name: str) -> np.ndarray:
    """Kernel (in, out) from a linear layer's (out, in) or a convolution's (out, in, 1)."""
    weight = w[f"{name}.weight"]
    return weight.reshape(weight.shape[:2]).T


def _swapped_for_conv(name: str, features: np.ndarray) -> np.ndarray:
    """Swap vertices and features for a convolution, whose kernel of size 1 acts on vertices."""
    return features.swapaxes(1, 2) if ".conv_" in name else features


def decode(w: Arrays, latents: np.ndarray) -> np.ndarray:
    """Offsets (B, V, 3), metres, of latents (B, 100); the weights include the normaliser."""
    names = layers_of(w)
    second_half = names[names.index("from_latent") :]
    values = forward(w, latents, second_half).outputs["to_coordinates"]
    return values * w["normaliser.scale_m"] + w["normaliser.mean_m"]


def learn(w: Arrays, values: np.ndarray, target: np.ndarray) -> Pass:
    """Loss between the reconstruction of values (B, V, 3) and a target, and its gradients."""
    chain = forward(w, values)
    loss, dy = layers.mean_squared_error(target, chain.outputs["to_coordinates"])
    gradients: Arrays = {}
    for name in reversed(layers_of(w)):
        dy = dy.reshape(chain.outputs[name].shape) * chain.slopes.get(name, 1.0)
        dy, by_kernel, gradients[f"{name}.bias"] = layers.dense_backward(
            _swapped_for_conv(name, dy), chain.inputs[name], _kernel(w, name)
        )
        dy = _swapped_for_conv(name, dy)
        gradients[f"{name}.weight"] = by_kernel.T.reshape(w[f"{name}.weight"].shape)
    return Pass(loss, gradients, {}, chain.outputs)


def ae_forward(w: Arrays, values: np.ndarray, architecture: Architecture, run: str) -> Tensors:
    """Every layer's output; in metres if the weights include the normaliser."""
    del architecture, run  # rows of a batch are independent
    if "normaliser.mean_m" not in w:
        return prefixed("layer", forward(w, values).outputs)
    mean_m, scale_m = w["normaliser.mean_m"], w["normaliser.scale_m"]
    normalised = (values - mean_m) / scale_m
    outputs = forward(w, normalised).outputs
    last = outputs["to_coordinates"] * scale_m + mean_m
    return prefixed(
        "layer", {"normaliser.normalise": normalised, **outputs, "normaliser.denormalise": last}
    )


def ae_decode(w: Arrays, latents: np.ndarray, architecture: Architecture) -> Tensors:
    """Offsets (B, V, 3), metres."""
    del architecture
    return {"layer/offsets": decode(w, latents)}


def ae_train(
    w: Arrays,
    values: np.ndarray,
    architecture: Architecture,
    steps: list[int],
    **target: np.ndarray,
) -> Tensors:
    """Loss, gradients, steps of Adam; without a `target` the values themselves are it."""
    del architecture
    expected = target.get("target", values)
    return train(w, lambda now: learn(now, values, expected), TORCH_ADAM, steps)
