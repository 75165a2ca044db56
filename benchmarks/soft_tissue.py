"""Throughput of the PyTorch layer of `dsnet_plus`, beside the loop that predictions repeat.

    python -m benchmarks.soft_tissue --out docs/results/soft_tissue.json

Offsets of all vertices of people who walk, from the same model, in turns in one process: the layer
over whole motions, without gradients and with them, and ONNX Runtime's step frame by frame, each
with as many threads as are best for it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

import dsnet
from benchmarks.processes import run_as_process
from bridge.options import PositiveInt
from bridge.runs.files import write_text_atomically
from bridge.runs.writer import machine
from dsnet.prediction.models import PlusModel
from torch_align_ae import SoftTissue


@dataclass(frozen=True)
class SoftTissueBenchConfig:
    """Time offsets of motions: some four minutes on two cores."""

    out: Path
    """JSON file to write."""
    people: tuple[PositiveInt, ...] = (1, 16, 64)
    """How many move at once."""
    gradients: PositiveInt = 16
    """The most people whose gradients are computed too."""
    frames: PositiveInt = 120
    """Of each motion."""
    rounds: PositiveInt = 3
    """Timed turns, after one that warms up."""
    threads: tuple[PositiveInt, ...] = (1, 2)
    """Each contender takes the number with which it is fastest."""
    device: str = "cpu"
    """Of the layer, as `cuda`; the loop runs on the processor."""


def main(config: SoftTissueBenchConfig) -> None:
    """Measure, and write the best of the numbers of threads' medians."""
    trained = dsnet.load_model("female")
    assert isinstance(trained.model, PlusModel)
    layer = SoftTissue(trained.model.trained, trained.body).to(config.device)
    results: dict[str, Any] = {f"people_{count}": {} for count in config.people}
    # One number after the other: threads that wait for work would take the other's core.
    for threads in sorted(config.threads):
        torch.set_num_threads(threads)
        loop = PlusModel(trained.model.trained, trained.body, threads)
        for count in config.people:
            best = results[f"people_{count}"]
            for name, speed in _frames_per_s(config, layer, loop, count).items():
                best[name] = max(best.get(name, 0.0), speed)
    for best in results.values():
        best["layer_over_loop"] = best["layer"] / best["onnxruntime_loop"]
    about = {"frames": config.frames, "rounds": config.rounds, "threads": config.threads}
    device = torch.cuda.get_device_name() if config.device == "cuda" else config.device
    results |= about | {"device": device, "torch": torch.__version__, "machine": machine()}
    write_text_atomically(config.out, json.dumps(results, indent=1) + "\n")


def _frames_per_s(
    config: SoftTissueBenchConfig, layer: SoftTissue, loop: PlusModel, count: int
) -> dict[str, float]:
    """Medians of people's frames a second."""
    walk = dsnet.load_motion("sample:walking").theta[: config.frames]
    motions = np.repeat(walk[None], count, 0).astype(np.float32)
    shapes = np.random.default_rng(count).normal(size=(count, 10)).astype(np.float32)
    theta, betas = (torch.from_numpy(array).to(config.device) for array in (motions, shapes))

    def by_layer() -> None:
        with torch.no_grad():
            layer(theta, betas)

    def with_gradient() -> None:
        layer.zero_grad()
        offsets_m, _ = layer(theta, betas.requires_grad_())
        offsets_m.square().mean().backward()

    def by_loop() -> None:
        state = loop.reset(shapes, motions[:, 0])
        for frame in range(config.frames):
            state, codes = loop.step(state, motions[:, frame])
            loop.offsets_m(shapes, codes, motions[:, frame])

    calls: dict[str, Callable[[], None]] = {"layer": by_layer, "onnxruntime_loop": by_loop}
    if count <= config.gradients:
        calls["layer_and_gradient"] = with_gradient
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(1 + config.rounds):
        for name, call in calls.items():
            began = time.perf_counter()
            call()
            if config.device == "cuda":
                torch.cuda.synchronize()
            seconds[name].append(time.perf_counter() - began)
    done = count * config.frames
    return {name: done / median(times[1:]) for name, times in seconds.items()}


if __name__ == "__main__":
    run_as_process(SoftTissueBenchConfig, main)
