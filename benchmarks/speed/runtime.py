"""From a pose to the posed skin, part by part, against limits.

Random weights at the paper's sizes, on the embedded body: what is timed does not depend on them.
All contenders take turns in one process, so that other load hits all alike; the limits are those of
`limits`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnxruntime

from benchmarks.processes import run_as_process
from benchmarks.speed.graphs import Contender, make_contenders
from benchmarks.speed.limits import Clock, GraphCall, measured, operations_bytes
from benchmarks.speed.results import write_results
from bridge.options import PositiveInt, Seed
from bridge.runs.writer import machine


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
    clock: Clock = "wall"
    """Wall time on all cores; or one core's own time, whose ratios hold on a busy machine too."""


def main(config: RuntimeBenchConfig) -> None:
    """Measure, and write runs/<run>/bench/runtime.json."""
    write_results(config.run, "runtime", measure(config))


def measure(config: RuntimeBenchConfig) -> dict[str, Any]:
    """Ratios to the limits, frames a second of one character, median milliseconds of each part."""
    contenders = make_contenders(config.seed, config.nodes)
    return {
        "clock": config.clock,
        **{
            f"characters_{count}": _of_one_count(config, contenders, count)
            for count in config.characters
        },
        "machine": machine(),
        "cores": os.cpu_count(),
        "onnxruntime": onnxruntime.__version__,
    }


def _of_one_count(
    config: RuntimeBenchConfig, contenders: Mapping[str, Contender], count: int
) -> dict[str, Any]:
    rng = np.random.default_rng([config.seed, count])
    threads = 1 if config.clock == "processor" else os.cpu_count() or 1
    calls = {name: GraphCall(made.model, rng, count, threads) for name, made in contenders.items()}
    largest = max(made.weights_bytes for made in contenders.values())
    medians, limits = measured(calls, largest, config.rounds, threads, config.clock)
    shares: dict[str, dict[str, float]] = {}
    for name, made in contenders.items():
        must_bytes = made.weights_bytes + calls[name].given_and_found_bytes()
        all_bytes = made.weights_bytes + operations_bytes(made.model, rng, count)
        shares[name] = {
            **limits.beside(medians[name], must_bytes, count * made.multiplications),
            "must_move_mb": must_bytes / 1e6,
            "operations_move_mb": all_bytes / 1e6,
        }
    return {
        **shares,
        "frames_per_s": {n: 1 / medians[n] for n in contenders if n.startswith("dsnet")},
        "read_gb_per_s": limits.bytes_per_s / 1e9,
        "square_gflops": 2 * limits.multiplications_per_s / 1e9,
    }


if __name__ == "__main__":
    run_as_process(RuntimeBenchConfig, main)
