"""Codes trained by products of bfloat16 numbers beside the same codes trained in float32.

Both trainings of a code begin with the same weights and see the same frames in the same order; R2
of what they give back is in float32 on frames that neither saw. Before, steps of both are timed
turn by turn in one process. A killed measurement goes on at its checkpoints.
"""

from __future__ import annotations

import json
import statistics
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch

from benchmarks.processes import run_as_process
from benchmarks.speed.autoencoder import interleaved_seconds, training_step
from benchmarks.speed.results import results_folder, write_results
from benchmarks.subspaces.codes import CODES, new_network
from benchmarks.subspaces.data import SubspaceData
from benchmarks.subspaces.scores import NetworkCodec, errors
from benchmarks.subspaces.trainings import Budget, UntrainedCode, remove_all
from bridge.options import PositiveInt, Seed
from bridge.paper import LATENT_SIZE
from bridge.runs import Run
from bridge.runs.writer import machine
from torch_align_ae.autoencoder.training import keep_freed_memory, multiplies_bfloat16

CodeName = Literal["mesh_measured", "mesh_literal", "casas_otaduy"]
PRECISIONS = ("float32", "bfloat16")


@dataclass(frozen=True)
class PrecisionConfig:
    """Train codes in both precisions on a run's alignment; results of other codes are kept.

    Five minutes of one core for a mesh autoencoder, nine and 6 GB for Casas-Otaduy's network.
    """

    run: str = "demo"
    """Folder under runs/ whose `align` is coded, and that receives bench/precision.json."""
    codes: tuple[CodeName, ...] = ("mesh_measured", "mesh_literal", "casas_otaduy")
    """Which codes: ours, the paper's plainest words, and its peer."""
    steps: PositiveInt = 120
    """Optimiser steps of 64 frames."""
    rounds: PositiveInt = 5
    """Timed steps of each precision."""
    seed: Seed = 0
    """Decides the split, the weights' beginning and the order of frames."""


def main(config: PrecisionConfig) -> None:
    """Measure, and write runs/<run>/bench/precision.json."""
    keep_freed_memory()
    data = SubspaceData.of(Run(config.run).artifact("align"), "frame", config.seed)
    path = results_folder(config.run) / "precision.json"
    found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {"codes": {}}
    for name in config.codes:
        found["codes"][name] = measure(name, config, data, path.parent)
        about = {"seed": config.seed, "threads": torch.get_num_threads()}
        instructions = {"avx512_bf16": multiplies_bfloat16()}
        write_results(
            config.run, "precision", {**found, **about, **instructions, "machine": machine()}
        )


def measure(
    name: CodeName, config: PrecisionConfig, data: SubspaceData, folder: Path
) -> dict[str, Any]:
    """A step's median seconds of processor time and R2 by precision, and how they compare."""
    seconds = step_seconds(name, config, data)
    folder.mkdir(parents=True, exist_ok=True)
    scores = {one: trained_r2(name, one, config, data, folder) for one in PRECISIONS}
    median = {one: statistics.median(seconds[one]) for one in PRECISIONS}
    return {
        "steps": config.steps,
        "step_cpu_s": seconds,
        "median_step_cpu_s": median,
        "step_to_float32": median["bfloat16"] / median["float32"],
        "r2": scores,
        "r2_change": {
            frames: scores["bfloat16"][frames] - scores["float32"][frames]
            for frames in ("validation", "held_out")
        },
    }


def step_seconds(
    name: CodeName, config: PrecisionConfig, data: SubspaceData
) -> dict[str, list[float]]:
    """Processor seconds of steps of one network, in both precisions by turns."""
    network, normaliser = new_network(CODES[name], LATENT_SIZE, data)
    offsets = normaliser.normalise(torch.from_numpy(data.offsets_m[data.split.train[:64]]))
    adam = torch.optim.Adam(network.parameters(), 1e-4, fused=True)
    steps = {
        one: training_step(adam, network, offsets, bfloat16=one == "bfloat16") for one in PRECISIONS
    }
    return interleaved_seconds(steps, config.rounds, offsets.device, time.process_time)


def trained_r2(
    name: CodeName, precision: str, config: PrecisionConfig, data: SubspaceData, folder: Path
) -> dict[str, float]:
    """R2 on validation frames and on the held-out sequences after training from the beginning."""
    budget = Budget(config.steps, 0, (), 64, config.steps, 256)
    checkpoint = folder / f"{name}_{precision}.safetensors"
    code = UntrainedCode(
        replace(CODES[name], searched=False), LATENT_SIZE, data, budget, checkpoint
    )
    training = code.training(code.rate({}), config.steps, checkpoint)
    training.plan = replace(training.plan, bfloat16=precision == "bfloat16")
    training.run()
    remove_all(checkpoint)
    codec = NetworkCodec(training.model.eval(), training.normaliser)
    return {
        "validation": errors(codec, data.offsets_m, data.split.validation)["r2"],
        "held_out": errors(codec, data.offsets_m, data.held_out)["r2"],
    }


if __name__ == "__main__":
    run_as_process(PrecisionConfig, main)
