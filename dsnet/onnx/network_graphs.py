"""The paper's networks as ONNX graphs, straight from named arrays.

One step of DSNet, the autoencoder's decoder, and one step with decoder and body.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange.dsnet import TrainedDsnet
from bridge.exchange.weights import BATCH_NORM_EPSILON, mesh_autoencoder_to_keras
from bridge.paper import FEATURES, INPUT_SIZE, N_BETAS, NEGATIVE_SLOPE, THETA_SIZE
from dsnet.onnx.body_graph import Surface, posed_bones, translated, translation
from dsnet.onnx.onnx_graph import Graph, Precision, StateLayout, Value, product

_DECODER = ("from_latent.", "decoder.", "to_coordinates.")
Weights = Mapping[str, NDArray]


def dsnet_layout(network: TrainedDsnet) -> StateLayout:
    """What a character's row holds: the LSTM's memory."""
    units = len(network.weights["batch_norm/gamma"])
    return StateLayout({"hidden": (units,), "cell": (units,)})


def dsnet_step_graph(network: TrainedDsnet) -> onnx.ModelProto:
    """The step of a trained DSNet alone.

    Inputs `motion` (B, 79), betas and theta, and `state`; outputs `codes` (B, 100), latents, and
    `next_state`.
    """
    graph, layout = Graph(), dsnet_layout(network)
    motion = graph.input("motion", ("B", INPUT_SIZE))
    past = layout.read(graph.input("state", ("B", layout.size)))
    latents, after = _stepped(graph, network, motion, past)
    outputs = {"codes": latents, "next_state": layout.written(graph, after)}
    return graph.model("dsnet_step", outputs, checked=False)


def dsnet_body_graph(
    network: TrainedDsnet,
    decoder: Weights,
    architecture: Mapping[str, Any],
    body: BodyModelData,
    metadata: Mapping[str, str] | None = None,
    precision: Precision = "float32",
) -> onnx.ModelProto:
    """A trained DSNet, its autoencoder's decoder and the body: a pose in, the posed skin out.

    Inputs `theta` (B, 69), `betas` (B, 10) and `state` (B, 120); outputs `vertices` (B, V, 3),
    metres, and `next_state` (B, 120). A row is the LSTM's memory of one character, zero where she
    begins, as in training: the network itself takes the first pose for one that was held
    (Section 4.2).

    Parameters
    ----------
    decoder : weights named as by PyTorch, with `normaliser.mean_m` and `normaliser.scale_m`.
    architecture : as in the manifest of `train-ae`.
    precision : of the large kernels.
    """
    if architecture["widths"][0] != body.vertex_count:
        raise DsnetError(
            f"a decoder of {architecture['widths'][0]} vertices",
            f"one of the body's {body.vertex_count}",
            "Name the body model that the run was aligned with.",
        )
    graph, layout = Graph(), dsnet_layout(network)
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    past = layout.read(graph.input("state", ("B", layout.size)))
    latents, after = _stepped(graph, network, graph.concat([betas, theta], 1), past)
    offsets_m = decoded(graph, decoder, architecture, latents, precision)
    bones, turning = posed_bones(graph, body, theta, betas)
    with graph.section("skin"):
        skin = Surface(graph, body, slice(None), precision=precision)
        rest = skin.rest(turning, betas) + offsets_m
        vertices = skin.skinned(translated(graph, bones, translation(theta)), rest)
    return graph.model(
        "dsnet",
        {"vertices": vertices, "next_state": layout.written(graph, after)},
        {"vertices": ("B", body.vertex_count, 3), "next_state": ("B", layout.size)},
        {**(metadata or {}), "latency_frames": "0", "state_layout": layout.as_text()},
    )


def _stepped(
    graph: Graph, network: TrainedDsnet, inputs: Value, past: Mapping[str, Value]
) -> tuple[Value, dict[str, Value]]:
    """Latents (B, 100) of inputs (B, 79) in a motion's own units, and the memory after them.

    What is affine is folded together once. All four gates come from one tanh, as
    sigmoid(z) = (1 + tanh(z / 2)) / 2.
    """
    w = {name: array.astype(np.float64) for name, array in network.weights.items()}
    scale = network.scaling
    gain = w["batch_norm/gamma"] / np.sqrt(w["batch_norm/moving_variance"] + BATCH_NORM_EPSILON)
    scaled = np.diag(1 / scale.input_std), -scale.input_mean / scale.input_std
    normalised = np.diag(gain), w["batch_norm/beta"] - gain * w["batch_norm/moving_mean"]
    restored = np.diag(scale.latent_std), scale.latent_mean
    dense = {n: (w[f"{n}/kernel"], w[f"{n}/bias"]) for n in ("fc_enc_1", "fc_enc_2", "fc_enc_3")}
    kernel = np.vstack([w["lstm/kernel"], w["lstm/recurrent_kernel"]])
    halved = np.repeat([0.5, 0.5, 1.0, 0.5], len(gain))

    def affine(name: str, features: Value, *layers: tuple[NDArray, NDArray]) -> Value:
        (kernel, bias), *others = layers
        for next_kernel, next_bias in others:
            kernel, bias = kernel @ next_kernel, bias @ next_kernel + next_bias
        return features @ graph.array(f"{name}/kernel", kernel) + graph.array(f"{name}/bias", bias)

    with graph.section("dsnet"):
        encoded = affine("encode", inputs, scaled, dense["fc_enc_1"], dense["fc_enc_2"])
        known = graph.concat([graph.apply("Tanh", encoded), past["hidden"]], 1)
        gates = affine("gates", known, (kernel * halved, w["lstm/bias"] * halved))
        # Keras's order: input, forget, candidate, output.
        i, f, candidate, o = graph.apply("Tanh", gates).split(1, [len(gain)] * 4)
        i, f, o = (0.5 + 0.5 * gate for gate in (i, f, o))
        cell = f * past["cell"] + i * candidate
        hidden = o * graph.apply("Tanh", cell)
        latents = affine("decode", hidden, normalised, dense["fc_enc_3"], restored)
        return latents, {"hidden": hidden, "cell": cell}


def decoder_graph(weights: Weights, architecture: Mapping[str, Any]) -> onnx.ModelProto:
    """Input `latents` (B, 100), output `offsets` (B, V, 3), metres.

    Parameters
    ----------
    weights : named as by PyTorch, with `normaliser.mean_m` and `normaliser.scale_m`.
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

    Vertices stay the last axis throughout: nine rows a character of each convolution's product,
    and of the largest, 55 MB, every number is read once however many characters there are.
    """
    own = {name: array for name, array in weights.items() if name.startswith(_DECODER)}
    held, widths = mesh_autoencoder_to_keras(own), architecture["widths"]

    def linear(layer: str, features: Value) -> Value:
        """On the last axis."""
        multiply = product(graph, f"{layer}/kernel", held[f"{layer}/kernel"], precision)
        return multiply(features) + graph.array(f"{layer}/bias", held[f"{layer}/bias"])

    def per_vertex(layer: str, features: Value) -> Value:
        """On each vertex's features (B, in, V)."""
        kernel, bias = (graph.array(f"{layer}/{n}", held[f"{layer}/{n}"])
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
