"""The mesh autoencoder (Section 4.1, Figure 3): each layer's output, and its gradient.

The network is a chain, so both directions are one loop over its list of layers. A layer acts on
the last axis, or mixes vertices if it is a convolution; a nonlinearity follows all but the two
that end encoder and decoder.
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
"""What other engines build their networks by; here the weights say it."""


class Chain(NamedTuple):
    outputs: Arrays
    """By layer, before its nonlinearity; after it as `<layer>_activation`."""
    inputs: Arrays
    """By layer."""
    slopes: Arrays
    """Of the nonlinearity, by layer that has one."""


def layers_of(w: Arrays) -> list[str]:
    numbers = range(1, 1 + sum(name.startswith("encoder.conv_") for name in w) // 2)
    encoder, decoder = ([f"{side}.conv_{k}" for k in numbers] for side in ("encoder", "decoder"))
    return [
        "encoder.linear_1", "encoder.linear_2", *encoder, "to_latent",
        "from_latent", *decoder, "decoder.linear_1", "to_coordinates",
    ]  # fmt: skip


def forward(w: Arrays, values: np.ndarray, names: Sequence[str] = ()) -> Chain:
    """Every layer's output for values (B, V, 3), or of some consecutive layers for their input."""
    chain, features = Chain({}, {}, {}), values
    for name in names or layers_of(w):
        if name == "to_latent":  # about the latents the features of all vertices are one long row
            features = features.reshape(len(features), -1)
        elif name == "decoder.conv_1":
            features = features.reshape(len(features), -1, FEATURES[-1])
        chain.inputs[name] = given = _mixed_last(name, features)
        features = layers.dense(given, _kernel(w, name), w[f"{name}.bias"])
        chain.outputs[name] = features = _mixed_last(name, features)
        if name not in _WITHOUT_NONLINEARITY:
            features, chain.slopes[name] = layers.leaky_relu(features)
            chain.outputs[f"{name}_activation"] = features
    return chain


def _kernel(w: Arrays, name: str) -> np.ndarray:
    """(in, out) of a linear layer's (out, in), or of a convolution's (out, in, 1)."""
    weight = w[f"{name}.weight"]
    return weight.reshape(weight.shape[:2]).T


def _mixed_last(name: str, features: np.ndarray) -> np.ndarray:
    """Vertices last, and back, where a convolution of kernel 1 mixes them."""
    return features.swapaxes(1, 2) if ".conv_" in name else features


def decode(w: Arrays, latents: np.ndarray) -> np.ndarray:
    """Offsets (B, V, 3) of latents (B, 100), in metres by the normaliser among the weights."""
    names = layers_of(w)
    second_half = names[names.index("from_latent") :]
    values = forward(w, latents, second_half).outputs["to_coordinates"]
    return values * w["normaliser.scale_m"] + w["normaliser.mean_m"]


def learn(w: Arrays, values: np.ndarray, target: np.ndarray) -> Pass:
    """Loss between what becomes of values (B, V, 3) and a target, and all of its gradients."""
    chain = forward(w, values)
    loss, dy = layers.mean_squared_error(target, chain.outputs["to_coordinates"])
    gradients: Arrays = {}
    for name in reversed(layers_of(w)):
        dy = dy.reshape(chain.outputs[name].shape) * chain.slopes.get(name, 1.0)
        dy, by_kernel, gradients[f"{name}.bias"] = layers.dense_backward(
            _mixed_last(name, dy), chain.inputs[name], _kernel(w, name)
        )
        dy = _mixed_last(name, dy)
        gradients[f"{name}.weight"] = by_kernel.T.reshape(w[f"{name}.weight"].shape)
    return Pass(loss, gradients, {}, chain.outputs)


def ae_forward(w: Arrays, values: np.ndarray, architecture: Architecture, run: str) -> Tensors:
    """Every layer; from metres to metres where the weights hold the normaliser."""
    del architecture, run  # rows do not know of each other
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
    """Offsets in metres."""
    del architecture
    return {"layer/offsets": decode(w, latents)}


def ae_train(
    w: Arrays,
    values: np.ndarray,
    architecture: Architecture,
    steps: list[int],
    **target: np.ndarray,
) -> Tensors:
    """Loss, gradients, steps of Adam; towards the values themselves if there is no `target`."""
    del architecture
    wanted = target.get("target", values)
    return train(w, lambda now: learn(now, values, wanted), TORCH_ADAM, steps)
