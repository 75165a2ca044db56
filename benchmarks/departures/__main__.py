"""`python -m benchmarks.departures --run demo`: what each departure from the paper's words buys.

Every autoencoder of the ladder learns from the run's `align`, the paper's aligner, for the same
number of steps; DSNet learns its codes and is measured like any run. A killed study goes on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import plugin
from benchmarks.departures.ladder import AUTOENCODERS, PREDICTORS, Step
from benchmarks.processes import run_as_process, run_dsnet, run_module
from bridge.runs import Run
from bridge.runs.files import write_text_atomically

SHARED = ("corpus", "truth", "align")


@dataclass(frozen=True)
class DeparturesConfig:
    """Train every step of the ladder and measure it."""

    out: Path
    """File for the results."""
    run: str = "demo"
    """Run whose `align` all learn from; its own predictors are not asked."""
    steps: int = 175
    """Steps of each autoencoder."""
    epochs: int = 500
    """Epochs of each predictor."""
    literal_steps: int = 0
    """Steps of the two literal autoencoders, trained once more for longer; 0: not."""
    seed: int = 0


def main(config: DeparturesConfig) -> None:
    plugin.use()
    rows, last = [], AUTOENCODERS[-1]
    for step in AUTOENCODERS:
        predictors = PREDICTORS if step is last else ()
        rows += _measured(config, step, config.steps, predictors)
    if config.literal_steps:
        for step in AUTOENCODERS[:2]:
            rows += _measured(config, step, config.literal_steps)
    results = {"data": Run(config.run).artifact("align").origin, "rows": rows}
    results |= {key: value for key, value in asdict(config).items() if key != "out"}
    write_text_atomically(config.out, json.dumps(results, indent=1) + "\n")


def _measured(
    config: DeparturesConfig, step: Step, steps: int, predictors: tuple[Step, ...] = ()
) -> list[dict[str, Any]]:
    """Rows of an autoencoder with the faithful DSNet, and of other predictors on its codes."""
    run = Run(f"{config.run}-{step.name}-{steps}")
    kept = run.path / "departures.json"
    if not kept.exists():
        _share(Run(config.run), run)
        common = ("--run", run.name, "--seed", str(config.seed))
        run_module(
            "benchmarks.departures.autoencoder", *common, "--step", step.name, "--steps", str(steps)
        )
        names = ["dsnet_faithful", *(one.predictor for one in predictors)]
        epochs = ("--epochs", str(config.epochs))
        run_dsnet("train", *common, *epochs, "--predictors", *names)
        for stage in ("infer", "decode", "evaluate"):
            run_dsnet(stage, "--run", run.name)
        rows = [_row(run, one, one.predictor) for one in (step, *predictors)]
        write_text_atomically(kept, json.dumps(rows) + "\n")
        shutil.rmtree(run.path / "decode")  # gigabytes
    return json.loads(kept.read_text(encoding="utf-8"))


def _share(source: Run, run: Run) -> None:
    run.path.mkdir(parents=True, exist_ok=True)
    for stage in SHARED:
        if (source.path / stage).exists() and not (run.path / stage).exists():
            (run.path / stage).symlink_to(Path("..") / source.path.name / stage)


def _row(run: Run, step: Step, predictor: str) -> dict[str, Any]:
    trained = run.artifact("train-ae")
    summary: Mapping[str, Any] = trained.manifest["autoencoder"]
    cells = run.artifact("evaluate").manifest["cells"]
    return {
        "name": step.name,
        "text": step.text,
        "predictor": predictor,
        "autoencoder_steps": summary["steps_taken"],
        "autoencoder_r2": summary["r2_validation"],
        "validation_loss": [float(x) for x in trained.array("validation_loss")],
        "validation_steps": [int(x) for x in trained.array("validation_steps")],
        "cells": {
            cell: {key: errors[predictor]["mesh"][key] for key in ("r2", "mean_mm")}
            for cell, errors in cells.items()
            if "mesh" in errors.get(predictor, {})
        },
        "machine": trained.manifest["provenance"]["machine"],
    }


if __name__ == "__main__":
    run_as_process(DeparturesConfig, main)
