"""Both networks as ONNX graphs, written straight from named arrays: no framework is needed.

Linear layers and convolutions are matrix products with Keras's kernels, so a graph holds the
arrays that `bridge.exchange.weights` gives, under the names that it gives them, and
`dsnet_weights` and `mesh_autoencoder_weights` read them back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.exchange.weights import (
    BATCH_NORM_EPSILON,
    lstm_from_onnx,
    lstm_to_onnx,
    mesh_autoencoder_from_keras,
    mesh_autoencoder_to_keras,
)
from bridge.paper import FEATURES
from bridge.runtime.graphs.onnx_builder import GraphBuilder

_ENCODER, _DECODER = ("encoder.", "to_latent."), ("from_latent.", "decoder.", "to_coordinates.")
ACTIVATIONS = {"leaky_relu": "LeakyRelu", "elu": "Elu", "tanh": "Tanh", "relu": "Relu"}
"""ONNX's names of the nonlinearities."""


def dsnet_graph(weights: Mapping[str, NDArray], *, trace: bool = False) -> onnx.ModelProto:
    """DSNet at rest, for whole motions or for one frame after another.

    Inputs `motion` (B, T, 79), and `hidden` and `cell` (1, B, 60), which are zero where a motion
    begins; outputs `latents` (B, T, 100), `next_hidden` and `next_cell`.

    Parameters
    ----------
    weights : named as by `tf_dsnet.model.named_weights`.
    trace : also give every layer's output, by the layer's name.
    """
    graph = GraphBuilder(weights["lstm/kernel"].dtype)
    units = len(weights["batch_norm/gamma"])
    graph.input("motion", ("B", "T", len(weights["fc_enc_1/kernel"])))
    for state in ("hidden", "cell"):
        graph.input(state, (1, "B", units))
    graph.hold({name: w for name, w in weights.items() if not name.startswith("lstm/")})
    graph.hold({f"lstm/{name}": array for name, array in lstm_to_onnx(weights).items()})

    encoded = graph.linear(graph.linear("motion", "fc_enc_1"), "fc_enc_2", "fc_enc_2/sum")
    memory = _lstm(graph, graph.node("Tanh", [encoded], "fc_enc_2"), units)
    latents = graph.linear(_batch_norm(graph, memory, weights["lstm/kernel"].dtype), "fc_enc_3")
    states = {"next_hidden": "lstm/last_hidden", "next_cell": "lstm/last_cell"}
    return graph.model("dsnet", {"latents": latents, **states}, trace=trace)


def dsnet_weights(held: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """DSNet's weights from the arrays that its graph holds."""
    lstm = {name: held[f"lstm/{name}"] for name in ("W", "R", "B")}
    others = {n: w for n, w in held.items() if n.startswith(("fc_enc_", "batch_norm/"))}
    del others["batch_norm/epsilon"]
    return {**others, **lstm_from_onnx(lstm)}


def encoder_graph(
    weights: Mapping[str, NDArray], architecture: Mapping[str, Any], *, trace: bool = False
) -> onnx.ModelProto:
    """Input `offsets` (B, V, 3), output `latents` (B, 100).

    Parameters
    ----------
    weights : named as by PyTorch. With `normaliser.mean_m` and `normaliser.scale_m` the graph
        takes metres, without them normalised offsets.
    architecture : `widths`, `activation`, `negative_slope`, as in the manifest of `train-ae`.
    trace : also give every layer's output by the layer's name, those of convolutions (B, 9, rows).
    """
    graph = _mesh_graph(weights, _ENCODER)
    features = graph.input("offsets", ("B", architecture["widths"][0], 3))
    if "normaliser.mean_m" in weights:
        centred = graph.node("Sub", [features, "normaliser.mean_m"], "normaliser/centred")
        features = graph.node("Div", [centred, "normaliser.scale_m"], "normaliser.normalise")
    features = _activated(graph, "encoder.linear_1", features, architecture)
    features = _activated(graph, "encoder.linear_2", features, architecture)
    row = graph.node(
        "Flatten", [_convolutions(graph, "encoder", features, architecture)], "to_row/row"
    )
    return graph.model("encoder", {"latents": graph.linear(row, "to_latent")}, trace=trace)


def decoder_graph(
    weights: Mapping[str, NDArray], architecture: Mapping[str, Any], *, trace: bool = False
) -> onnx.ModelProto:
    """Input `latents` (B, 100), output `offsets` (B, V, 3); parameters as in `encoder_graph`."""
    graph = _mesh_graph(weights, _DECODER)
    latents = graph.input("latents", ("B", weights["from_latent.weight"].shape[1]))
    row = _activated(graph, "from_latent", latents, architecture)
    graph.hold({"from_row/shape": np.array([-1, architecture["widths"][-1], FEATURES[-1]])})
    features = graph.node("Reshape", [row, "from_row/shape"], "from_row/features")
    features = _convolutions(graph, "decoder", features, architecture)
    features = _activated(graph, "decoder.linear_1", features, architecture)
    offsets = graph.linear(features, "to_coordinates")
    if "normaliser.mean_m" in weights:
        scaled = graph.node("Mul", [offsets, "normaliser.scale_m"], "normaliser/scaled")
        offsets = graph.node("Add", [scaled, "normaliser.mean_m"], "normaliser.denormalise")
    return graph.model("decoder", {"offsets": offsets}, trace=trace)


def mesh_autoencoder_weights(held: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The autoencoder's weights from the arrays that its two graphs hold together."""
    return mesh_autoencoder_from_keras(
        {name: array for name, array in held.items() if name.endswith(("/kernel", "/bias"))}
    )


def _lstm(graph: GraphBuilder, features: str, units: int) -> str:
    """The LSTM's hidden states (B, T, 60); ONNX wants time first and a direction's axis."""
    by_time = graph.node("Transpose", [features], "lstm/by_time", perm=[1, 0, 2])
    inputs = [by_time, "lstm/W", "lstm/R", "lstm/B", "", "hidden", "cell"]
    outputs = ("lstm/directions", "lstm/last_hidden", "lstm/last_cell")
    directions = graph.node("LSTM", inputs, *outputs, hidden_size=units)  # (T, 1, B, 60)
    graph.hold({"lstm/direction": np.array([1])})
    by_time = graph.node("Squeeze", [directions, "lstm/direction"], "lstm/memory_by_time")
    return graph.node("Transpose", [by_time], "lstm", perm=[1, 0, 2])


def _batch_norm(graph: GraphBuilder, memory: str, dtype: np.dtype) -> str:
    name = "batch_norm/{}".format
    graph.hold({name("epsilon"): np.array(BATCH_NORM_EPSILON, dtype)})
    padded = graph.node("Add", [name("moving_variance"), name("epsilon")], name("padded"))
    spread = graph.node("Sqrt", [padded], name("spread"))
    centred = graph.node("Sub", [memory, name("moving_mean")], name("centred"))
    unit = graph.node("Div", [centred, spread], name("unit"))
    scaled = graph.node("Mul", [unit, name("gamma")], name("scaled"))
    return graph.node("Add", [scaled, name("beta")], "batch_norm")


def _mesh_graph(weights: Mapping[str, NDArray], parts: tuple[str, ...]) -> GraphBuilder:
    graph = GraphBuilder(weights["to_latent.weight"].dtype)
    own = {name: array for name, array in weights.items() if name.startswith(parts)}
    graph.hold(mesh_autoencoder_to_keras(own))
    graph.hold({name: w for name, w in weights.items() if name.startswith("normaliser.")})
    return graph


def _convolutions(
    graph: GraphBuilder, side: str, features: str, architecture: Mapping[str, Any]
) -> str:
    """Mix vertices, (B, in, 9) to (B, out, 9), as products over the last axis."""
    features = graph.node("Transpose", [features], f"{side}/vertices_last", perm=[0, 2, 1])
    for number in range(1, len(architecture["widths"])):
        features = _activated(graph, f"{side}.conv_{number}", features, architecture)
    return graph.node("Transpose", [features], f"{side}/vertices_first", perm=[0, 2, 1])


def _activated(
    graph: GraphBuilder, layer: str, features: str, architecture: Mapping[str, Any]
) -> str:
    """A linear layer and its nonlinearity."""
    activation = architecture["activation"]
    slope = {"alpha": architecture["negative_slope"]} if activation == "leaky_relu" else {}
    features = graph.linear(features, layer)
    return graph.node(ACTIVATIONS[activation], [features], f"{layer}_activation", **slope)
