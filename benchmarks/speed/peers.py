"""The deployable graphs beside what others would run.

From a pose to posed vertices: our graph and our PyTorch module, smplx and smplfitter, each given
the embedded body in SMPL's own format. From latents to offsets: the paper's decoder and Casas and
Otaduy's, each in ONNX Runtime and in PyTorch, with random weights. Peers that are not installed are
left out. All are tuned: float32, no gradients, all cores, memory kept between calls, warm. Before
they are timed, all must give the same vertices and offsets. Turns and limits are those of
`limits`.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from benchmarks.processes import run_as_process
from benchmarks.speed.graphs import (
    ARCHITECTURE,
    Contender,
    decoder_arrays,
    decoder_graph,
    graph_of,
    multiplications,
    skinned,
    weights_bytes,
)
from benchmarks.speed.limits import Clock, GraphCall, measured
from benchmarks.speed.posing_peers import PEERS, Call, DrawnBodies, posers
from benchmarks.speed.results import write_results
from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.options import PositiveInt, Seed
from bridge.paper import CASAS_OTADUY_WIDTHS, LATENT_SIZE
from bridge.runs.writer import machine
from dsnet.onnx.onnx_graph import Graph, Value
from torch_align_ae import CasasOtaduyAutoencoder, MeshAutoencoder
from torch_align_ae.autoencoder.training import keep_freed_memory

_SAME = 1e-4
"""Of the largest number."""
_OFFSETS_BYTES = 4 * CASAS_OTADUY_WIDTHS[0]
"""What is written for a body; what it is given is small."""


@dataclass(frozen=True)
class PeersBenchConfig:
    """Time posing and decoders beside their peers: about two minutes, 7 GB of memory."""

    run: str = "demo"
    """Folder under runs/ that receives bench/peers.json."""
    seed: Seed = 0
    """Seed of the random weights and poses."""
    rounds: PositiveInt = 25
    """Timed turns, after two that warm up."""
    bodies: tuple[PositiveInt, ...] = (1, 16, 64)
    """How many at once."""
    clock: Clock = "wall"
    """Wall time on all cores; or one core's own time, whose ratios hold on a busy machine too."""


@dataclass(frozen=True, eq=False)
class BothDecoders:
    """A decoder in ONNX Runtime and in PyTorch."""

    graph: Contender
    module: Callable[[Tensor], Tensor]
    """(B, 100) to (B, V, 3) in the graph's units."""


def main(config: PeersBenchConfig) -> None:
    """Measure, and write runs/<run>/bench/peers.json."""
    write_results(config.run, "peers", measure(config))


def measure(config: PeersBenchConfig) -> dict[str, Any]:
    """How many times as long as ours each peer takes, by number of bodies; with all limits."""
    keep_freed_memory()
    threads = 1 if config.clock == "processor" else os.cpu_count() or 1
    torch.set_num_threads(threads)
    results: dict[str, Any] = {"clock": config.clock}
    with torch.inference_mode():
        results["posing"] = _posing(config, threads)
        results["decoding"] = _decoding(config, threads)
    return {
        **results,
        "machine": machine(),
        "threads": threads,
        "versions": {
            name: importlib.metadata.version(name)
            for name in ("onnxruntime", "torch", "numba", *PEERS)
            if importlib.util.find_spec(name) is not None
        },
    }


def _posing(config: PeersBenchConfig, threads: int) -> dict[str, Any]:
    """From poses to posed vertices, by number of bodies."""
    body = load_body_model("embedded:female")
    model = graph_of(lambda graph: skinned(graph, body))
    made = Contender(model, multiplications(0)["skinning"], weights_bytes(model))
    makers, found = posers(body, model, threads), {}
    for count in config.bodies:
        bodies = DrawnBodies.drawn(np.random.default_rng([config.seed, count]), count)
        calls = {name: maker(bodies) for name, maker in makers.items()}
        _require_same({name: call() for name, call in calls.items()})
        found[str(count)] = _beside(config, calls, dict.fromkeys(calls, made), count, threads)
    return found


def _decoding(config: PeersBenchConfig, threads: int) -> dict[str, Any]:
    """From latents to offsets, by number of bodies."""
    decoders, found = {"paper": _paper(config.seed), "casas_otaduy": _casas_otaduy(config.seed)}, {}
    for count in config.bodies:
        rng = np.random.default_rng([config.seed, count])
        calls: dict[str, Call] = {}
        for name, both in decoders.items():
            graph = GraphCall(both.graph.model, rng, count, threads)
            latents = torch.from_numpy(graph.feed["latents"])
            calls[f"{name}_onnx"] = graph
            calls[f"{name}_torch"] = partial(both.module, latents)
            _require_same({"onnx": graph()["found"], "torch": calls[f"{name}_torch"]()})
        graphs = {name: decoders[name.rpartition("_")[0]].graph for name in calls}
        found[str(count)] = _beside(config, calls, graphs, count, threads)
    return found


def _beside(
    config: PeersBenchConfig,
    calls: Mapping[str, Call],
    graphs: Mapping[str, Contender],
    count: int,
    threads: int,
) -> dict[str, dict[str, float]]:
    """Each call beside the first, and beside its limits: those of the graph that does the same."""
    largest = max(graph.weights_bytes for graph in graphs.values())
    medians, limits = measured(calls, largest, config.rounds, threads, config.clock)
    first = next(iter(calls))
    shares: dict[str, dict[str, float]] = {}
    for name, graph in graphs.items():
        moved_bytes = graph.weights_bytes + count * _OFFSETS_BYTES
        products = count * graph.multiplications
        shares[name] = {
            "times_ours": medians[name] / medians[first],
            **limits.beside(medians[name], moved_bytes, products),
        }
    return shares


def _paper(seed: int) -> BothDecoders:
    arrays = decoder_arrays(seed)
    graph = decoder_graph(arrays)
    module = MeshAutoencoder(tuple(ARCHITECTURE["widths"]))
    weights = {name: torch.from_numpy(a) for name, a in arrays.items() if "normal" not in name}
    module.load_state_dict(weights)
    scale_m = torch.from_numpy(arrays["normaliser.scale_m"])
    made = Contender(graph, multiplications(0)["decoder"], weights_bytes(graph))
    # The graph's offsets are (B, 3, V), as skinning wants them.
    return BothDecoders(made, lambda latents: (module.decode(latents) * scale_m).transpose(1, 2))


def _casas_otaduy(seed: int) -> BothDecoders:
    torch.manual_seed(seed)
    decoder = CasasOtaduyAutoencoder(CASAS_OTADUY_WIDTHS[:-1]).decoder  # as large as the encoder
    layers = [layer for layer in decoder if isinstance(layer, torch.nn.Linear)]

    def build(graph: Graph) -> Value:
        features = graph.input("latents", ("B", LATENT_SIZE))
        for number, layer in enumerate(layers):
            if number > 0:
                features = graph.apply("LeakyRelu", features, alpha=0.1)
            kernel = graph.array(f"kernel_{number}", layer.weight.T)
            features = features @ kernel + graph.array(f"bias_{number}", layer.bias)
        return features.reshape(0, -1, 3)

    graph, widths = graph_of(build), CASAS_OTADUY_WIDTHS[::-1]
    products = sum(a * b for a, b in pairwise(widths))
    made = Contender(graph, products, weights_bytes(graph))
    return BothDecoders(made, lambda latents: decoder(latents).unflatten(1, (-1, 3)))


def _require_same(found: Mapping[str, ArrayLike]) -> None:
    """Refuse to compare the speed of things that differ."""
    arrays = {name: np.asarray(array) for name, array in found.items()}
    first = next(iter(arrays.values()))
    for name, array in arrays.items():
        apart = np.abs(array - first).max() / np.abs(first).max()
        if not apart <= _SAME:
            raise DsnetError(
                f"results of {name} that differ by {apart:.1e} of the largest number",
                f"at most {_SAME:.0e}",
                "Install the versions of constraints.txt.",
            )


if __name__ == "__main__":
    run_as_process(PeersBenchConfig, main)
