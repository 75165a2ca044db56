"""The engines `onnx` and `stream` of `dsnet verify`: what the product deploys.

ONNX Runtime has forward passes in float32 only: it has no float64 LSTM or ELU, and ONNX keeps the
slope of LeakyReLU in float32. The streaming predictor takes one frame at a time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange.dsnet import TrainedDsnet
from bridge.paper import DSNET_WIDTHS, N_BETAS
from bridge.runtime import network_graphs
from bridge.runtime.onnx_graph import GraphSession, held_arrays
from bridge.runtime.plus_graph import plus_graph as plus_body_graph
from bridge.runtime.streams import StreamingPredictor
from bridge.tissue.trained_plus import TrainedPlus
from bridge.verify.engine import Tensors, batches, joined, prefixed, serve

_VERTICES_LAST = ("encoder.", "decoder.", "to_coordinates", "normaliser.")


def dsnet_forward(weights: Tensors, motion: NDArray, run: str) -> Tensors:
    """Every layer: the whole batch, row by row, or frame by frame."""
    session = GraphSession(network_graphs.dsnet_graph(weights, trace=True))

    def at_rest(batch: NDArray) -> Tensors:
        state = np.zeros((1, len(batch), DSNET_WIDTHS["lstm"]), np.float32)
        return {"hidden": state, "cell": state}

    if run != "steps":
        parts = [session(motion=rows, **at_rest(rows)) for rows in batches(motion, run)]
        return joined(map(_layers, parts))
    frames, state = [], at_rest(motion)
    for frame in np.split(motion, motion.shape[1], axis=1):
        outputs = session(motion=frame, **state)
        state = {name: outputs[f"next_{name}"] for name in state}
        frames.append(_layers(outputs))
    return joined(frames, axis=1)


def dsnet_stream(weights: Tensors, motion: NDArray) -> Tensors:
    """Latents of motions (B, T, 79), B characters side by side."""
    predictor = StreamingPredictor(TrainedDsnet.from_arrays("dsnet", weights))
    frames = [
        predictor.step(frame[:, N_BETAS:], frame[:, :N_BETAS]) for frame in motion.swapaxes(0, 1)
    ]
    return {"layer/latents": np.stack(frames, axis=1)}


def ae_forward(
    weights: Tensors, values: NDArray, architecture: Mapping[str, Any], run: str
) -> Tensors:
    """Every layer, and the normaliser's where the weights hold one."""
    encode = GraphSession(network_graphs.encoder_graph(weights, architecture, trace=True))
    decode = GraphSession(network_graphs.decoder_graph(weights, architecture, trace=True))
    parts = []
    for rows in batches(values, run):
        encoded = encode(offsets=rows)
        parts.append(_layers(encoded) | _layers(decode(latents=encoded["latents"])))
    return joined(parts)


def dsnet_graph(
    weights: Tensors, theta: NDArray, betas: NDArray, body: str, architecture: Mapping[str, Any]
) -> Tensors:
    """The whole graph of DSNet and the decoder, frame by frame, from poses to the posed skin."""
    network, data = TrainedDsnet.from_arrays("dsnet", weights), load_body_model(body)
    graph = network_graphs.dsnet_body_graph(network, weights, architecture, data)
    return _stepped(graph, theta, betas)


def plus_graph(weights: Tensors, theta: NDArray, betas: NDArray, body: str) -> Tensors:
    """The same of `dsnet_plus`."""
    graph = plus_body_graph(TrainedPlus.from_arrays(weights), load_body_model(body))
    return _stepped(graph, theta, betas)


def _stepped(graph: onnx.ModelProto, theta: NDArray, betas: NDArray) -> Tensors:
    session, frames = GraphSession(graph), []
    state = np.zeros((len(betas), session.input_shapes["state"][1]), np.float32)
    for pose in theta:
        outputs = session(theta=pose, betas=betas, state=state)
        state = outputs["next_state"]
        frames.append(outputs["vertices"])
    return {"layer/vertices": np.stack(frames)}


def formats(weights: Tensors, architecture: Mapping[str, Any] | None = None) -> Tensors:
    """Weights as saved graphs hold them: DSNet's, or the autoencoder's of an architecture."""
    if architecture is None:
        held = _through_file(network_graphs.dsnet_graph(weights))
        return prefixed("weight/onnx", network_graphs.dsnet_weights(held))
    held = {}
    for build in (network_graphs.encoder_graph, network_graphs.decoder_graph):
        held |= _through_file(build(weights, architecture))
    return prefixed("weight/onnx", network_graphs.mesh_autoencoder_weights(held))


def _layers(outputs: Tensors) -> Tensors:
    """Layers alone, features last."""
    results = ("latents", "offsets", "next_hidden", "next_cell")
    return {
        name: array.swapaxes(1, 2) if name.startswith(_VERTICES_LAST) else array
        for name, array in outputs.items()
        if name not in results
    }


def _through_file(model: onnx.ModelProto) -> Tensors:
    with tempfile.TemporaryDirectory() as folder:
        onnx.save_model(model, Path(folder) / "network.onnx")
        return held_arrays(Path(folder) / "network.onnx")


if __name__ == "__main__":
    operations = (dsnet_forward, dsnet_stream, ae_forward, dsnet_graph, plus_graph, formats)
    serve(*operations, packages=("onnx", "onnxruntime"))
