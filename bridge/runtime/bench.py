"""`python -m bridge.runtime.bench`: from a pose to the posed skin, part by part, against limits.

Random weights at the paper's sizes, on the embedded body: what is timed does not depend on them.
All contenders take turns in one process, so that other load hits all alike. Two limits are taken in
the same turns: reading a part's weights from memory once, which is what a part for one character
waits for, and a matrix product at the rate of a large square one, which is what many wait for.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.exchange.trained_dsnet import Scaling, TrainedDsnet
from bridge.options import PositiveInt, Seed
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
from bridge.runs import Run
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process
from bridge.runtime.graphs.body_graph import surface, turned
from bridge.runtime.graphs.bones_graph import (
    BONES,
    TURNING,
    posed_bones,
    translated,
    translation,
)
from bridge.runtime.graphs.dsnet_body_graph import decoded, dsnet_body_graph
from bridge.runtime.graphs.onnx_values import Value, ValueGraph
from bridge.runtime.graphs.plus_graph import plus_graph, spread
from bridge.runtime.graphs.tissue_graph import Person, SheetGraph
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import OscillatorSheet
from bridge.tissue.trained_plus import TrainedPlus
from bridge.verify import draws

_SQUARE = 1024
_ARCHITECTURE = {"widths": INFERRED_WIDTHS, "activation": "leaky_relu", "negative_slope": 0.1}
Feed = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class RuntimeBenchConfig:
    """Time the deployable graphs and their parts: about a minute on two cores."""

    run: str = "demo"
    """Folder under runs/ that receives bench/runtime.json."""
    seed: Seed = 0
    """Seed of the random weights and poses."""
    rounds: PositiveInt = 25
    """Timed turns, after two that warm up."""
    characters: tuple[PositiveInt, ...] = (1, 16, 64)
    """How many at once."""
    nodes: PositiveInt = 500
    """Of `dsnet_plus`."""
    clock: Literal["wall", "processor"] = "wall"
    """Wall time on all cores; or one core's own time, whose ratios hold on a busy machine too."""


PROFILES = {
    "smoke": RuntimeBenchConfig(run="smoke", rounds=3),
    "demo": RuntimeBenchConfig(),
    "paper": RuntimeBenchConfig(run="paper"),
}


@dataclass(frozen=True, eq=False)
class Contender:
    """A graph, and what limits it."""

    model: onnx.ModelProto
    multiplications: int
    """Of matrix products, a character and frame."""
    weights_bytes: int
    """What a frame reads of the graph's own arrays."""


def main(config: RuntimeBenchConfig) -> None:
    """Measure, and write runs/<run>/bench/runtime.json."""
    folder = Run(config.run).path / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    results = measure(config)
    write_text_atomically(folder / "runtime.json", json.dumps(results, indent=1) + "\n")


def measure(config: RuntimeBenchConfig) -> dict[str, Any]:
    """Ratios to the limits, frames a second of one character, median milliseconds of each part."""
    contenders = make_contenders(config)
    return {
        "clock": config.clock,
        **{
            f"characters_{count}": _of_one_count(config, contenders, count)
            for count in config.characters
        },
        "machine": f"{platform.system()} {platform.machine()}",
        "cores": os.cpu_count(),
        "onnxruntime": onnxruntime.__version__,
    }


def make_contenders(config: RuntimeBenchConfig) -> dict[str, Contender]:
    """Parts first, then whole graphs."""
    body = load_body_model("embedded:female")
    drawn = draws.tissue(config.seed, body, config.nodes)
    plus = TrainedPlus.from_arrays(drawn | TissueNodes.of(body, config.nodes).arrays())
    decoder = {
        **draws.autoencoder_weights(config.seed, INFERRED_WIDTHS),
        "normaliser.mean_m": np.zeros((N_VERTICES, 3), np.float32),
        "normaliser.scale_m": np.full((N_VERTICES, 3), 1e-3, np.float32),
    }
    network = TrainedDsnet("dsnet", draws.dsnet_weights(config.seed), Scaling.identity())
    models = {
        "load": _graph(lambda g: _load(g, plus, body)),
        "step": _graph(lambda g: _step(g, plus, body)),
        "spread": _graph(lambda g: spread(g, plus.nodes, g.input("now", ("B", 3, config.nodes)))),
        "decoder": _graph(
            lambda g: decoded(g, decoder, _ARCHITECTURE, g.input("latents", ("B", LATENT_SIZE)))
        ),
        "skinning": _graph(lambda g: _skinning(g, body)),
        "dsnet_plus": plus_graph(plus, body),
        "dsnet_plus_int8": plus_graph(plus, body, precision="int8"),
        "dsnet": dsnet_body_graph(network, decoder, _ARCHITECTURE, body),
        "dsnet_int8": dsnet_body_graph(network, decoder, _ARCHITECTURE, body, precision="int8"),
    }
    counts = _multiplications(config.nodes)
    return {
        name: Contender(model, counts[name.removesuffix("_int8")], _bytes(model))
        for name, model in models.items()
    }


def _of_one_count(
    config: RuntimeBenchConfig, contenders: Mapping[str, Contender], count: int
) -> dict[str, Any]:
    rng = np.random.default_rng([config.seed, count])
    threads = 1 if config.clock == "processor" else os.cpu_count() or 1
    calls = {name: _call(made.model, rng, count, threads) for name, made in contenders.items()}
    calls["square"] = _call(_square(), rng, _SQUARE, threads)
    largest = np.ones(max(made.weights_bytes for made in contenders.values()) // 4, np.float32)
    clock = time.thread_time if config.clock == "processor" else time.perf_counter
    with ThreadPoolExecutor(threads) as pool:
        pieces = np.array_split(largest, threads)
        read = map if threads == 1 else pool.map
        calls["read"] = lambda: list(read(np.add.reduce, pieces))
        seconds = _interleaved(calls, config.rounds, clock)
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    bytes_per_s = largest.nbytes / medians["read"]
    per_s = _SQUARE**3 / medians["square"]
    shares: dict[str, dict[str, float]] = {}
    for name, made in contenders.items():
        reading_s = made.weights_bytes / bytes_per_s
        multiplying_s = count * made.multiplications / per_s
        shares[name] = {
            "times_reading_weights": medians[name] / reading_s,
            "times_multiplying": medians[name] / multiplying_s,
            "ms": 1e3 * medians[name],
        }
    return {
        **shares,
        "frames_per_s": {n: 1 / medians[n] for n in contenders if n.startswith("dsnet")},
        "read_gb_per_s": bytes_per_s / 1e9,
        "square_gflops": 2 * per_s / 1e9,
    }


def _interleaved(
    calls: Mapping[str, Callable[[], object]], rounds: int, clock: Callable[[], float]
) -> dict[str, list[float]]:
    """Seconds of `rounds` calls each, turn by turn, after two turns that do not count."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(rounds + 2):
        for name, call in calls.items():
            started = clock()
            call()
            if turn > 1:
                seconds[name].append(clock() - started)
    return seconds


def _call(
    model: onnx.ModelProto, rng: np.random.Generator, count: int, threads: int
) -> Callable[[], object]:
    """One frame of a graph; a state goes on from frame to frame."""
    options = onnxruntime.SessionOptions()
    # Threads of a session that has just run spin for a while: in the way of the one that is timed.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.intra_op_num_threads = threads
    options.log_severity_level = 3  # a part leaves arrays of the whole unused, and would be told so
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    feed = {
        given.name: rng.normal(0, 0.01, (count, *given.shape[1:])).astype(np.float32)
        for given in session.get_inputs()
    }
    if "state" in feed:
        feed["state"] = np.zeros_like(feed["state"])
    names = [output.name for output in session.get_outputs()]

    def frame() -> None:
        found = dict(zip(names, session.run(None, feed), strict=True))
        if "next_state" in found:
            feed["state"] = np.asarray(found["next_state"])

    return frame


def _graph(build: Callable[[ValueGraph], Value]) -> onnx.ModelProto:
    graph = ValueGraph()
    return graph.model("part", {"found": build(graph)}, {})


def _square() -> onnx.ModelProto:
    """The largest rate of multiplications: a product of two square matrices."""
    return _graph(lambda g: g.input("a", ("B", _SQUARE)) @ g.input("b", ("B", _SQUARE)))


def _load(graph: ValueGraph, model: TrainedPlus, body: BodyModelData) -> Value:
    """From a pose to the load on each node."""
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    before = graph.input("before", ("B", 3, len(model.nodes)))
    posed = posed_bones(graph, body, theta, betas)
    nodes = surface(graph, body, model.nodes.vertices)
    *columns, shift = (posed.bones @ nodes.weights).split(1, [3, 3, 3, 3])
    places = turned(columns, shift, nodes.rest(posed.features, betas), axis=1)
    return _sheet(graph, model, body).felt(3600.0 * (places - before), columns)


def _step(graph: ValueGraph, model: TrainedPlus, body: BodyModelData) -> Value:
    """A frame of the oscillators."""
    nodes = len(model.nodes)
    omega, stiffening = (graph.input(n, ("B", 1, nodes)) for n in ("omega", "stiffening"))
    names = ("normals", "now", "before", "load")
    normals, *moving = (graph.input(name, ("B", 3, nodes)) for name in names)
    now, before, load = moving
    person = Person(omega, stiffening, normals)
    return _sheet(graph, model, body).frame(person, now, before, load)[0]


def _sheet(graph: ValueGraph, model: TrainedPlus, body: BodyModelData) -> SheetGraph:
    sheet = OscillatorSheet(model.mechanics(body, np.zeros(N_BETAS)), model.nodes.laplacian)
    return SheetGraph(graph, model, sheet)


def _skinning(graph: ValueGraph, body: BodyModelData) -> Value:
    theta = graph.input("theta", ("B", THETA_SIZE))
    betas = graph.input("betas", ("B", N_BETAS))
    posed = posed_bones(graph, body, theta, betas)
    skin = surface(graph, body, slice(None))
    rest = skin.rest(posed.features, betas)
    return skin.skinned(translated(graph, posed.bones, translation(theta)), rest)


def _bytes(model: onnx.ModelProto) -> int:
    """Of the arrays that every frame reads: those that only a beginning needs are small."""
    return sum(len(tensor.raw_data) for tensor in model.graph.initializer)


def _multiplications(nodes: int) -> dict[str, int]:
    """A character and frame, by part."""
    posing = (TURNING + N_BETAS) * 3 + 12 * BONES + 9
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


if __name__ == "__main__":
    run_as_process(RuntimeBenchConfig, main)
