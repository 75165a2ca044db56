"""What the benchmarks time: the deployable graphs and their parts, with random weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.exchange.dsnet import Scaling, TrainedDsnet
from bridge.paper import (
    DSNET_WIDTHS,
    FEATURES,
    INFERRED_WIDTHS,
    INPUT_SIZE,
    LATENT_SIZE,
    N_BETAS,
    N_VERTICES,
    THETA_SIZE,
)
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.body_graph import (
    BONES,
    POSE_FEATURES,
    Surface,
    posed_bones,
    translated,
    translation,
    turned,
)
from dsnet.onnx.network_graphs import decoded, dsnet_body_graph
from dsnet.onnx.onnx_graph import Graph, Value
from dsnet.onnx.plus_graph import interpolated, plus_graph
from dsnet.onnx.tissue_graph import Springs, TissueGraph
from dsnet.verify import draws

ARCHITECTURE = {"widths": INFERRED_WIDTHS}


@dataclass(frozen=True, eq=False)
class Contender:
    """A graph, and what limits it."""

    model: onnx.ModelProto
    multiplications: int
    """Of matrix products, a character and frame."""
    weights_bytes: int
    """What a frame reads of the graph's own arrays."""


def make_contenders(seed: int, nodes: int) -> dict[str, Contender]:
    """Parts first, then whole graphs; `nodes` of `dsnet_plus`."""
    body = load_body_model("embedded:female")
    drawn = draws.tissue(seed, body, nodes)
    plus = TrainedPlus.from_arrays(drawn | TissueNodes.of(body, nodes).arrays())
    decoder = decoder_arrays(seed)
    network = TrainedDsnet("dsnet", draws.dsnet_weights(seed), Scaling.identity())
    models = {
        "load": graph_of(lambda g: _load(g, plus, body)),
        "step": graph_of(lambda g: _step(g, plus, body)),
        "spread": graph_of(lambda g: interpolated(g, plus.nodes, g.input("now", ("B", 3, nodes)))),
        "decoder": decoder_graph(decoder),
        "skinning": graph_of(lambda g: skinned(g, body)),
        "dsnet_plus": plus_graph(plus, body),
        "dsnet_plus_int8": plus_graph(plus, body, precision="int8"),
        "dsnet": dsnet_body_graph(network, decoder, ARCHITECTURE, body),
        "dsnet_int8": dsnet_body_graph(network, decoder, ARCHITECTURE, body, precision="int8"),
    }
    counts = multiplications(nodes)
    return {
        name: Contender(model, counts[name.removesuffix("_int8")], weights_bytes(model))
        for name, model in models.items()
    }


def decoder_arrays(seed: int) -> dict[str, NDArray[np.float32]]:
    """The paper's autoencoder as PyTorch names it, and a normaliser of millimetres."""
    return {
        **draws.autoencoder_weights(seed, INFERRED_WIDTHS),
        "normaliser.mean_m": np.zeros((N_VERTICES, 3), np.float32),
        "normaliser.scale_m": np.full((N_VERTICES, 3), 1e-3, np.float32),
    }


def decoder_graph(arrays: Mapping[str, NDArray]) -> onnx.ModelProto:
    """Latents (B, 100) to offsets (B, 3, V), metres, by the paper's decoder."""
    latents = ("B", LATENT_SIZE)
    return graph_of(lambda g: decoded(g, arrays, ARCHITECTURE, g.input("latents", latents)))


def graph_of(build: Callable[[Graph], Value]) -> onnx.ModelProto:
    """A part of a graph as a graph; its output is `found`."""
    graph = Graph()
    return graph.model("part", {"found": build(graph)}, {})


def _load(graph: Graph, model: TrainedPlus, body: BodyModelData) -> Value:
    """From a pose to the load on each node."""
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    before = graph.input("before", ("B", 3, len(model.nodes)))
    bones, features = posed_bones(graph, body, theta, betas)
    nodes = Surface(graph, body, model.nodes.vertices)
    *columns, shift = (bones @ nodes.weights).split(1, [3, 3, 3, 3])
    places = turned(columns, shift, nodes.rest(features, betas))
    return TissueGraph.of(graph, model).load(3600.0 * (places - before), columns)


def _step(graph: Graph, model: TrainedPlus, body: BodyModelData) -> Value:
    """A frame of the oscillators."""
    nodes = len(model.nodes)
    shapes = Springs.shapes(nodes).items()
    springs = Springs(**{name: graph.input(name, ("B", *shape)) for name, shape in shapes})
    now, before, load = (graph.input(n, ("B", 3, nodes)) for n in ("now", "before", "load"))
    return TissueGraph.of(graph, model).frame(springs, now, before, load)[0]


def skinned(graph: Graph, body: BodyModelData) -> Value:
    """From a pose to posed vertices (B, V, 3), without offsets."""
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    bones, features = posed_bones(graph, body, theta, betas)
    skin = Surface(graph, body, slice(None))
    rest = skin.rest(features, betas)
    return skin.skinned(translated(graph, bones, translation(theta)), rest)


def weights_bytes(model: onnx.ModelProto) -> int:
    """Of the arrays that every frame reads: those that only a beginning needs are small."""
    return sum(len(tensor.raw_data) for tensor in model.graph.initializer)


def multiplications(nodes: int) -> dict[str, int]:
    """A character and frame, by part."""
    posing = (POSE_FEATURES + N_BETAS) * 3 + 12 * BONES + 9
    load, step = nodes * posing, 6 * 3 * nodes**2
    skinning, spreading = N_VERTICES * posing, 8 * 3 * N_VERTICES
    widths = INFERRED_WIDTHS[::-1]
    decoder = FEATURES[-1] * (sum(a * b for a, b in pairwise(widths)) + LATENT_SIZE * widths[0])
    first, second, units = (DSNET_WIDTHS[name] for name in ("fc_enc_1", "fc_enc_2", "lstm"))
    network = INPUT_SIZE * first + first * second
    network += 4 * units * (second + units) + units * LATENT_SIZE
    return {
        "load": load,
        "step": step,
        "spread": spreading,
        "decoder": decoder,
        "skinning": skinning,
        "dsnet_plus": load + step + spreading + skinning,
        "dsnet": network + decoder + skinning,
    }
