"""`python -m bridge.verify.onnx_engine`: what onnxruntime answers to `dsnet verify`.

Forward passes in float32 only: onnxruntime has no float64 LSTM or ELU, and ONNX keeps the slope of
LeakyReLU in float32.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.exchange.trained_dsnet import TrainedDsnet
from bridge.paper import DSNET_WIDTHS
from bridge.runtime import network_graphs
from bridge.runtime.network_graphs import dsnet_body_graph
from bridge.runtime.onnx_graph import GraphSession, held_arrays
from bridge.runtime.plus_graph import plus_graph as plus_body_graph
from bridge.tissue.trained_plus import TrainedPlus
from bridge.verify.answers import joined, layers, prefixed
from bridge.verify.protocol import Case, Tensors, serve

_VERTICES_LAST = ("encoder.", "decoder.", "to_coordinates", "normaliser.")


def dsnet_forward(case: Case) -> Tensors:
    """Every layer: the whole batch, row by row, or frame by frame."""
    run = GraphSession(network_graphs.dsnet_graph(case.weights(), trace=True))
    motion = case.inputs()["motion"]

    def at_rest(batch: NDArray) -> dict[str, NDArray]:
        state = np.zeros((1, len(batch), DSNET_WIDTHS["lstm"]), np.float32)
        return {"hidden": state, "cell": state}

    def whole(batch: NDArray) -> Tensors:
        return _layers(run(motion=batch, **at_rest(batch)))

    def frames() -> Iterator[Tensors]:
        state = at_rest(motion)
        for frame in np.split(motion, motion.shape[1], axis=1):
            outputs = run(motion=frame, **state)
            state = {name: outputs[f"next_{name}"] for name in state}
            yield _layers(outputs)

    steps = case.options["run"] == "steps"
    return joined(frames(), axis=1) if steps else layers(case, whole, motion)


def ae_forward(case: Case) -> Tensors:
    """Every layer, and the normaliser's where the weights hold one."""
    weights, architecture = case.weights(), case.options["architecture"]
    encode = GraphSession(network_graphs.encoder_graph(weights, architecture, trace=True))
    decode = GraphSession(network_graphs.decoder_graph(weights, architecture, trace=True))

    def run(offsets: NDArray) -> Tensors:
        encoded = encode(offsets=offsets)
        return _layers(encoded) | _layers(decode(latents=encoded["latents"]))

    return layers(case, run, next(iter(case.inputs().values())))


def dsnet_graph(case: Case) -> Tensors:
    """The whole graph of DSNet, frame by frame."""
    weights, body = case.weights(), load_body_model(case.options["body"])
    network = TrainedDsnet.from_arrays("dsnet", weights)
    return _stepped(case, dsnet_body_graph(network, weights, case.options["architecture"], body))


def plus_graph(case: Case) -> Tensors:
    """The whole graph of `dsnet_plus`, frame by frame."""
    model, body = TrainedPlus.from_arrays(case.weights()), load_body_model(case.options["body"])
    return _stepped(case, plus_body_graph(model, body))


def _stepped(case: Case, model: onnx.ModelProto) -> Tensors:
    run, given, frames = GraphSession(model), case.inputs(), []
    state = np.zeros((len(given["betas"]), run.input_shapes["state"][1]), np.float32)
    for theta in given["theta"]:
        outputs = run(theta=theta, betas=given["betas"], state=state)
        state = outputs["next_state"]
        frames.append(outputs["vertices"])
    return {"layer/vertices": np.stack(frames)}


def formats(case: Case) -> Tensors:
    """Weights as the saved graphs hold them."""
    weights, path = case.weights(), case.scratch / "network.onnx"
    if case.options["network"] == "dsnet":
        held = _through_file(network_graphs.dsnet_graph(weights), path)
        return prefixed("weight/onnx", network_graphs.dsnet_weights(held))
    held = {}
    for build in (network_graphs.encoder_graph, network_graphs.decoder_graph):
        held |= _through_file(build(weights, case.options["architecture"]), path)
    return prefixed("weight/onnx", network_graphs.mesh_autoencoder_weights(held))


def _layers(outputs: Tensors) -> Tensors:
    """Layers alone, features last."""
    results = ("latents", "offsets", "next_hidden", "next_cell")
    return {
        name: array.swapaxes(1, 2) if name.startswith(_VERTICES_LAST) else array
        for name, array in outputs.items()
        if name not in results
    }


def _through_file(model: onnx.ModelProto, path: Path) -> dict[str, NDArray]:
    onnx.save_model(model, path)
    return held_arrays(path)


if __name__ == "__main__":
    serve(
        {
            "dsnet_forward": dsnet_forward,
            "ae_forward": ae_forward,
            "dsnet_graph": dsnet_graph,
            "plus_graph": plus_graph,
            "formats": formats,
        },
        packages=("onnx", "onnxruntime"),
    )
