"""The engines `onnx` and `stream` of `dsnet verify`, both in float32.

`onnx` runs the exported graphs frame by frame, from poses to the posed skin, and the decoder;
`stream` runs the streaming predictor, which gives latents.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange.dsnet import TrainedDsnet
from bridge.exchange.engine import Tensors, serve
from bridge.paper import N_BETAS
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx import network_graphs
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.onnx.plus_graph import plus_graph as plus_body_graph
from dsnet.stream.streaming_predictor import StreamingPredictor


def dsnet_stream(weights: Tensors, motion: NDArray) -> Tensors:
    """Latents of motions (B, T, 79), B characters side by side."""
    predictor = StreamingPredictor(TrainedDsnet.from_arrays("dsnet", weights))
    frames = [
        predictor.step(frame[:, N_BETAS:], frame[:, :N_BETAS]) for frame in motion.swapaxes(0, 1)
    ]
    return {"layer/latents": np.stack(frames, axis=1)}


def ae_decode(weights: Tensors, latents: NDArray, architecture: Mapping[str, Any]) -> Tensors:
    """Offsets (B, V, 3), metres, of latents (B, 100)."""
    session = GraphSession(network_graphs.decoder_graph(weights, architecture))
    return {"layer/offsets": session(latents=latents)["offsets"]}


def dsnet_graph(
    weights: Tensors, theta: NDArray, betas: NDArray, body: str, architecture: Mapping[str, Any]
) -> Tensors:
    """Posed skin of poses theta (T, B, 69), by DSNet and the decoder, frame by frame."""
    network, data = TrainedDsnet.from_arrays("dsnet", weights), load_body_model(body)
    graph = network_graphs.dsnet_body_graph(network, weights, architecture, data)
    return {"layer/vertices": GraphSession(graph).rollout(theta, betas)}


def plus_graph(weights: Tensors, theta: NDArray, betas: NDArray, body: str) -> Tensors:
    """Posed skin of poses theta (T, B, 69), by `dsnet_plus`, frame by frame."""
    graph = plus_body_graph(TrainedPlus.from_arrays(weights), load_body_model(body))
    return {"layer/vertices": GraphSession(graph).rollout(theta, betas)}


if __name__ == "__main__":
    serve(dsnet_stream, ae_decode, dsnet_graph, plus_graph, packages=("onnx", "onnxruntime"))
