"""`dsnet bench`: each framework's timings and the runtime's, each taken in a process of its own."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import Any

from bridge.options import Seed
from bridge.runs import Run
from bridge.runs.processes import run_module


@dataclass(frozen=True)
class BenchConfig:
    """Time training and streaming, and from a pose to the posed skin, beside peers that are there.

    Results go to runs/<run>/bench/{torch,tensorflow,runtime,peers}.json.
    """

    run: str = "demo"
    """Folder under runs/ that receives the results."""
    seed: Seed = 0
    """Seed of the random inputs."""


MODULES = (
    "torch_align_ae.bench",
    "tf_dsnet.bench",
    "bridge.runtime.bench",
    "torch_align_ae.bench_peers",
)
PROFILES = {name: BenchConfig() for name in ("smoke", "demo", "paper")}


def main(config: BenchConfig) -> None:
    """Run the benchmarks one after the other, so that none disturbs another."""
    for module in MODULES:
        run_module(module, "--run", config.run, "--seed", str(config.seed))
    for path in sorted((Run(config.run).path / "bench").glob("*.json")):
        results = json.loads(path.read_text(encoding="utf-8"))
        sys.stdout.write(f"{path}\n{_summary(results)}\n")


def _summary(results: dict[str, Any], indent: str = "  ") -> str:
    """The numbers of a results file, one a line; lists of single timings are left out."""
    lines = []
    for name, value in results.items():
        if isinstance(value, dict):
            inner = _summary(value, indent + "  ")
            lines += [f"{indent}{name}", inner] if inner else []
        elif isinstance(value, (int, float)):
            lines.append(f"{indent}{name:<36}{value:.4g}")
    return "\n".join(lines)
