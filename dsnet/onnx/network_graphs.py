"""The paper's networks as ONNX graphs, made from named arrays.

One step of DSNet, the autoencoder's decoder, and one step with decoder and body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import onnx
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange.dsnet import TrainedDsnet
from bridge.exchange.weights import mesh_autoencoder_to_keras
from bridge.paper import FEATURES, INPUT_SIZE, N_BETAS, NEGATIVE_SLOPE, THETA_SIZE
from dsnet.onnx.body_graph import Surface, posed_bones, translated, translation
from dsnet.onnx.layer_graphs import dsnet_layout, dsnet_step
from dsnet.onnx.onnx_graph import Graph, Value
from dsnet.onnx.precision import Precision, product

_DECODER = ("from_latent.", "decoder.", "to_coordinates.")
Weights = Mapping[str, NDArray]


def dsnet_step_graph(network: TrainedDsnet) -> onnx.ModelProto:
    """One step of a trained DSNet without decoder and body.

    Inputs are `motion` (B, 79), betas and theta, and `state`; outputs are the latents, `codes`
    (B, 100), and `next_state`.
    """
    graph, layout = Graph(), dsnet_layout(network)
    motion = graph.input("motion", ("B", INPUT_SIZE))
    past = layout.read(graph.input("state", ("B", layout.size)))
    latents, after = dsnet_step(graph, network, motion, past)
    outputs = {"codes": latents, "next_state": layout.written(graph, after)}
    return graph.model("dsnet_step", outputs, checked=False)


def dsnet_body_graph(
    network: TrainedDsnet,
    decoder: Weights,
    architecture: Mapping[str, Any],
    body: BodyModelData,
    metadata: Mapping[str, str] | None = None,
    precision: Precision = "float32",
    control_flow: bool = True,
    with_offsets: bool = False,
) -> onnx.ModelProto:
    """A trained DSNet, its autoencoder's decoder and the body: a pose in, the posed skin out.

    Inputs are `theta` (B, 69), `betas` (B, 10) and `state` (B, S); outputs are `vertices`
    (B, V, 3), metres, and `next_state` (B, S). S is 120 for the paper's network. A row of the state
    is one character's LSTM state, zeros in its first frame, as in training (Section 4.2).

    Parameters
    ----------
    decoder : weights with PyTorch's names, and `normaliser.mean_m` and `normaliser.scale_m`.
    architecture : as in the manifest of `train-ae`.
    precision : of the large kernels.
    control_flow : without it there is no `Scan`.
    with_offsets : `offsets` (B, V, 3) in the rest pose, metres, are an output too.
    """
    if architecture["widths"][0] != body.vertex_count:
        raise DsnetError(
            f"a decoder of {architecture['widths'][0]} vertices",
            f"one of the body's {body.vertex_count}",
            "Name the body model that the run was aligned with.",
        )
    graph, layout = Graph(control_flow), dsnet_layout(network)
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    past = layout.read(graph.input("state", ("B", layout.size)))
    latents, after = dsnet_step(graph, network, graph.concat([betas, theta], 1), past)
    offsets_m = decoded(graph, decoder, architecture, latents, precision)
    bones, features = posed_bones(graph, body, theta, betas)
    with graph.section("skin"):
        skin = Surface(graph, body, slice(None), precision=precision)
        rest = skin.rest(features, betas) + offsets_m
        vertices = skin.skinned(translated(graph, bones, translation(theta)), rest)
    outputs = {"vertices": vertices}
    if with_offsets:
        outputs["offsets"] = offsets_m.transpose(0, 2, 1)
    shapes = dict.fromkeys(outputs, ("B", body.vertex_count, 3))
    return graph.model(
        "dsnet",
        outputs | {"next_state": layout.written(graph, after)},
        shapes | {"next_state": ("B", layout.size)},
        {**(metadata or {}), "latency_frames": "0", "state_layout": layout.as_text()},
    )


def decoder_graph(weights: Weights, architecture: Mapping[str, Any]) -> onnx.ModelProto:
    """The decoder alone: input `latents` (B, 100), output `offsets` (B, V, 3), metres.

    Parameters
    ----------
    weights : with PyTorch's names, and `normaliser.mean_m` and `normaliser.scale_m`.
    architecture : its `widths`, as in the manifest of `train-ae`.
    """
    graph = Graph()
    latents = graph.input("latents", ("B", weights["from_latent.weight"].shape[1]))
    offsets = decoded(graph, weights, architecture, latents).transpose(0, 2, 1)
    return graph.model("decoder", {"offsets": offsets})


def decoded(
    graph: Graph,
    weights: Weights,
    architecture: Mapping[str, Any],
    latents: Value,
    precision: Precision = "float32",
) -> Value:
    """Offsets (B, 3, V) of latents (B, 100), by the decoder of Section 4.1.

    Vertices are the last axis throughout: a convolution is then one product with nine rows a
    character, which reads its kernel once for all characters; the largest kernel has 55 MB.
    """
    decoder = {name: array for name, array in weights.items() if name.startswith(_DECODER)}
    arrays, widths = mesh_autoencoder_to_keras(decoder), architecture["widths"]

    def linear(layer: str, features: Value) -> Value:
        """A linear layer on the last axis."""
        multiply = product(graph, f"{layer}/kernel", arrays[f"{layer}/kernel"], precision)
        return multiply(features) + graph.array(f"{layer}/bias", arrays[f"{layer}/bias"])

    def per_vertex(layer: str, features: Value) -> Value:
        """A linear layer on each vertex's features (B, in, V)."""
        kernel, bias = (graph.array(f"{layer}/{n}", arrays[f"{layer}/{n}"])
                        for n in ("kernel", "bias"))  # fmt: skip
        return kernel.transpose(1, 0) @ features + bias.reshape(1, -1, 1)

    def activated(values: Value) -> Value:
        return graph.apply("LeakyRelu", values, alpha=NEGATIVE_SLOPE)

    with graph.section("decoder"):
        row = activated(linear("from_latent", latents))
        features = row.reshape(0, widths[-1], FEATURES[-1]).transpose(0, 2, 1)
        for number in range(1, len(widths)):
            features = activated(linear(f"decoder.conv_{number}", features))
        features = activated(per_vertex("decoder.linear_1", features))
        scale_m, mean_m = (graph.array(name, weights[name].T)
                           for name in ("normaliser.scale_m", "normaliser.mean_m"))  # fmt: skip
        return per_vertex("to_coordinates", features) * scale_m + mean_m
