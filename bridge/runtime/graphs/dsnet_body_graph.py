"""The paper's DSNet as one ONNX graph: a pose in, the posed skin with its offsets out.

Inputs `theta` (B, 69), `betas` (B, 10) and `state` (B, 120); outputs `vertices` (B, V, 3), metres,
and `next_state` (B, 120). A row is the LSTM's memory of one character, zero where she begins, as in
training: the network itself takes the first pose for one that was held (Section 4.2).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange.dsnet import TrainedDsnet
from bridge.exchange.weights import BATCH_NORM_EPSILON
from bridge.paper import FEATURES, INPUT_SIZE, LATENT_SIZE, N_BETAS, THETA_SIZE
from bridge.runtime.graphs.body_graph import surface
from bridge.runtime.graphs.bones_graph import posed_bones, translated, translation
from bridge.runtime.graphs.onnx_graphs import ACTIVATIONS
from bridge.runtime.graphs.onnx_kernels import Precision, product
from bridge.runtime.graphs.onnx_values import Value, ValueGraph
from bridge.runtime.graphs.state_layout import StateLayout


def dsnet_layout(network: TrainedDsnet) -> StateLayout:
    """What a character's row holds."""
    units = len(network.weights["batch_norm/gamma"])
    return StateLayout({"hidden": (units,), "cell": (units,)})


def dsnet_step_graph(network: TrainedDsnet) -> onnx.ModelProto:
    """The step of a trained DSNet alone.

    Inputs `motion` (B, 79), betas and theta, and `state`; outputs `codes` (B, 100), latents, and
    `next_state`.
    """
    graph, layout = ValueGraph(), dsnet_layout(network)
    motion = graph.input("motion", ("B", INPUT_SIZE))
    past = layout.read(graph.input("state", ("B", layout.size)))
    latents, after = _stepped(graph, network, motion, past)
    outputs = {"codes": latents, "next_state": layout.written(graph, after)}
    shapes = {"codes": ("B", LATENT_SIZE), "next_state": ("B", layout.size)}
    return graph.model("dsnet_step", outputs, shapes, checked=False)


def dsnet_body_graph(
    network: TrainedDsnet,
    decoder: Mapping[str, NDArray],
    architecture: Mapping[str, Any],
    body: BodyModelData,
    metadata: Mapping[str, str] | None = None,
    precision: Precision = "float32",
) -> onnx.ModelProto:
    """The graph of a trained DSNet and its autoencoder's decoder.

    Parameters
    ----------
    decoder : weights named as by PyTorch, with `normaliser.mean_m` and `normaliser.scale_m`.
    architecture : as in the manifest of `train-ae`.
    precision : of the large kernels.

    Raises
    ------
    DsnetError
        If the decoder is of another body.
    """
    if architecture["widths"][0] != body.vertex_count:
        raise DsnetError(
            f"a decoder of {architecture['widths'][0]} vertices",
            f"one of the body's {body.vertex_count}",
            "Name the body model that the run was aligned with.",
        )
    graph, layout = ValueGraph(), dsnet_layout(network)
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    past = layout.read(graph.input("state", ("B", layout.size)))
    latents, after = _stepped(graph, network, graph.concat([betas, theta], 1), past)
    offsets_m = decoded(graph, decoder, architecture, latents, precision)
    posed = posed_bones(graph, body, theta, betas)
    with graph.section("skin"):
        skin = surface(graph, body, slice(None), precision=precision)
        rest = skin.rest(posed.features, betas) + offsets_m
        bones = translated(graph, posed.bones, translation(theta))
        vertices = skin.skinned(bones, rest)
    return graph.model(
        "dsnet",
        {"vertices": vertices, "next_state": layout.written(graph, after)},
        {"vertices": ("B", body.vertex_count, 3), "next_state": ("B", layout.size)},
        {**(metadata or {}), "latency_frames": "0", "state_layout": layout.as_text()},
    )


def decoded(
    graph: ValueGraph,
    weights: Mapping[str, NDArray],
    architecture: Mapping[str, Any],
    latents: Value,
    precision: Precision = "float32",
) -> Value:
    """Offsets (B, 3, V), metres, of latents (B, 100), by the decoder of Section 4.1.

    Vertices stay the last axis throughout: nine rows a character of each convolution's product,
    and of the largest, 55 MB, every number is read once however many characters there are.
    """
    with graph.section("decoder"):
        row = _activated(graph, architecture, _dense(graph, weights, "from_latent", latents))
        features = row.reshape(0, architecture["widths"][-1], FEATURES[-1]).transpose(0, 2, 1)
        for number in range(1, len(architecture["widths"])):
            layer = f"decoder.conv_{number}"
            kernel = product(graph, f"{layer}.kernel", weights[f"{layer}.weight"][..., 0].T,
                             precision)  # fmt: skip
            mixed = kernel(features) + graph.array(f"{layer}.bias", weights[f"{layer}.bias"])
            features = _activated(graph, architecture, mixed)
        features = _activated(graph, architecture, _across(graph, weights, "decoder.linear_1",
                                                           features))  # fmt: skip
        values = _across(graph, weights, "to_coordinates", features)
        scale_m, mean_m = (weights[f"normaliser.{name}"].T for name in ("scale_m", "mean_m"))
        return values * graph.array("scale_m", scale_m) + graph.array("mean_m", mean_m)


def _stepped(
    graph: ValueGraph, network: TrainedDsnet, inputs: Value, past: Mapping[str, Value]
) -> tuple[Value, dict[str, Value]]:
    """Latents (B, 100) of inputs (B, I) in a motion's own units, and the memory after them.

    All four gates come from one tanh, as sigmoid(z) = (1 + tanh(z / 2)) / 2.
    """
    with graph.section("dsnet"):
        encode, recur, decode = (
            _affine(graph, name, *folded)
            for name, folded in zip(("encode", "gates", "decode"), _folded(network), strict=True)
        )
        features = graph.apply("Tanh", encode(inputs))
        turned = graph.apply("Tanh", recur(graph.concat([features, past["hidden"]], 1)))
        # Keras's order: input, forget, candidate, output.
        i, f, candidate, o = turned.split(1, [len(network.weights["batch_norm/gamma"])] * 4)
        i, f, o = (0.5 + 0.5 * gate for gate in (i, f, o))
        cell = f * past["cell"] + i * candidate
        hidden = o * graph.apply("Tanh", cell)
        return decode(hidden), {"hidden": hidden, "cell": cell}


def _folded(network: TrainedDsnet) -> list[tuple[NDArray, NDArray]]:
    """Kernel and bias of what is affine in a trained network, folded together once: inputs to
    tanh's argument, features and hidden state to the gates, hidden state to latents."""
    w = {name: array.astype(np.float64) for name, array in network.weights.items()}
    scale = network.scaling
    gain = w["batch_norm/gamma"] / np.sqrt(w["batch_norm/moving_variance"] + BATCH_NORM_EPSILON)
    scaled = np.diag(1 / scale.input_std), -scale.input_mean / scale.input_std
    normalised = np.diag(gain), w["batch_norm/beta"] - gain * w["batch_norm/moving_mean"]
    restored = np.diag(scale.latent_std), scale.latent_mean
    dense = {n: (w[f"{n}/kernel"], w[f"{n}/bias"]) for n in ("fc_enc_1", "fc_enc_2", "fc_enc_3")}
    kernel = np.vstack([w["lstm/kernel"], w["lstm/recurrent_kernel"]])
    halved = np.repeat([0.5, 0.5, 1.0, 0.5], len(gain))
    return [
        _then(scaled, dense["fc_enc_1"], dense["fc_enc_2"]),
        (kernel * halved, w["lstm/bias"] * halved),
        _then(normalised, dense["fc_enc_3"], restored),
    ]


def _then(*layers: tuple[NDArray, NDArray]) -> tuple[NDArray, NDArray]:
    """One affine map in place of several that follow one another."""
    (kernel, bias), *others = layers
    for next_kernel, next_bias in others:
        kernel, bias = kernel @ next_kernel, bias @ next_kernel + next_bias
    return kernel, bias


def _affine(
    graph: ValueGraph, name: str, kernel: NDArray, bias: NDArray
) -> Callable[[Value], Value]:
    held, added = graph.array(f"{name}/kernel", kernel), graph.array(f"{name}/bias", bias)
    return lambda features: features @ held + added


def _dense(graph: ValueGraph, weights: Mapping[str, NDArray], layer: str, features: Value) -> Value:
    """PyTorch's linear layer on the last axis."""
    kernel = graph.array(f"{layer}.kernel", weights[f"{layer}.weight"].T)
    return features @ kernel + graph.array(f"{layer}.bias", weights[f"{layer}.bias"])


def _across(
    graph: ValueGraph, weights: Mapping[str, NDArray], layer: str, features: Value
) -> Value:
    """A linear layer of each vertex's features (B, in, V)."""
    kernel = graph.array(f"{layer}.kernel", weights[f"{layer}.weight"])
    bias = graph.array(f"{layer}.bias", weights[f"{layer}.bias"][:, None])
    return graph.apply("MatMul", kernel, features) + bias


def _activated(graph: ValueGraph, architecture: Mapping[str, Any], features: Value) -> Value:
    activation = architecture["activation"]
    slope = {"alpha": architecture["negative_slope"]} if activation == "leaky_relu" else {}
    return graph.apply(ACTIVATIONS[activation], features, **slope)
