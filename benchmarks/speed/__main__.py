"""`python -m benchmarks.speed --run demo`: every measurement, each in a process of its own."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import Any

from benchmarks.processes import run_as_process, run_module
from benchmarks.speed.results import results_folder
from bridge.options import Seed


@dataclass(frozen=True)
class SpeedConfig:
    """Time training and streaming, and from a pose to the posed skin, beside peers that are there.

    Results go to runs/<run>/bench/{torch,tensorflow,runtime,peers}.json.
    """

    run: str = "demo"
    """Folder under runs/ that receives the results."""
    seed: Seed = 0
    """Seed of the random inputs."""


PARTS = ("autoencoder", "dsnet", "runtime", "peers")


def main(config: SpeedConfig) -> None:
    """Run the benchmarks one after the other, so that none disturbs another."""
    for part in PARTS:
        run_module(f"benchmarks.speed.{part}", "--run", config.run, "--seed", str(config.seed))
    for path in sorted(results_folder(config.run).glob("*.json")):
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


if __name__ == "__main__":
    run_as_process(SpeedConfig, main)
