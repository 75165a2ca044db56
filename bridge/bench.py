"""`dsnet bench`: each framework's timings, taken in a process of its own."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.processes import run_module


@dataclass(frozen=True)
class BenchConfig:
    """Time the autoencoder and DSNet; results go to runs/<run>/bench/{torch,tensorflow}.json."""

    run: str = "demo"
    """Folder under runs/ that receives the results."""
    seed: int = 0
    """Seed of the random inputs."""


PROFILES = {name: BenchConfig() for name in ("smoke", "demo", "paper")}


def main(config: BenchConfig) -> None:
    """Run both benchmarks one after the other, so that neither disturbs the other."""
    for module in ("torch_align_ae.bench", "tf_dsnet.bench"):
        run_module(module, "--run", config.run, "--seed", str(config.seed))
