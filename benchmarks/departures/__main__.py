"""`python -m benchmarks.departures --run demo --out FILE`: what each departure buys.

Every autoencoder learns from the same corpus for the same number of steps; DSNet learns its latents
and is measured like any run. A killed study goes on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import plugin
from benchmarks.departures.ladder import CODES, STEPS, Step
from benchmarks.processes import run_as_process, run_dsnet, run_module
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import ALIGNMENT


@dataclass(frozen=True)
class DeparturesConfig:
    """Train and measure every step of the ladder."""

    out: Path
    """File for the results."""
    run: str = "demo"
    """Run whose corpus and alignment by SGD all have."""
    steps: int = 175
    """Steps of each autoencoder."""
    longer: int = 0
    """Steps of the two literal autoencoders, trained once more for longer; 0: not."""
    epochs: int = 750
    """Epochs of each predictor."""
    seed: int = 0


def main(config: DeparturesConfig) -> None:
    plugin.use()
    rows = [row for code in CODES for row in _measured(config, code, config.steps)]
    for code in ("literal", "literal_per_coordinate") if config.longer else ():
        rows += _measured(config, code, config.longer)
    results = {"data": Run(config.run).artifact(ALIGNMENT).origin, "rows": rows}
    results |= {key: value for key, value in asdict(config).items() if key != "out"}
    write_text_atomically(config.out, json.dumps(results, indent=1) + "\n")


def _measured(config: DeparturesConfig, code: str, steps: int) -> list[dict[str, Any]]:
    """Rows of the steps with one code."""
    run = Run(f"{config.run}-{code}-{steps}")
    kept = run.path / "departures.json"
    if not kept.exists():
        here = [step for step in STEPS if step.code == code]
        common = ("--run", run.name, "--seed", str(config.seed))
        _align(Run(config.run), run, CODES[code].aligner)
        autoencoder = ("--code", code, "--steps", str(steps))
        run_module("benchmarks.departures.autoencoder", *common, *autoencoder)
        names = [step.predictor for step in here]
        run_dsnet("train", *common, "--epochs", str(config.epochs), "--predictors", *names)
        for stage in ("infer", "decode", "evaluate"):
            run_dsnet(stage, "--run", run.name)
        rows = [_row(run, step) for step in here]
        write_text_atomically(kept, json.dumps(rows) + "\n")
        shutil.rmtree(run.path / "decode")  # gigabytes
    return json.loads(kept.read_text(encoding="utf-8"))


def _align(source: Run, run: Run, aligner: str) -> None:
    """Link what the run has in common with the source; another aligner aligns anew."""
    run.path.mkdir(parents=True, exist_ok=True)
    for stage in ("corpus", "truth", *([ALIGNMENT] if aligner == "sgd" else [])):
        if (source.path / stage).exists() and not (run.path / stage).exists():
            (run.path / stage).symlink_to(Path("..") / source.path.name / stage)
    if aligner != "sgd":
        run_dsnet("align", "--run", run.name, "--aligner", aligner)


def _row(run: Run, step: Step) -> dict[str, Any]:
    trained = run.artifact("train-ae")
    summary: Mapping[str, Any] = trained.manifest["autoencoder"]
    cells = run.artifact("evaluate").manifest["cells"]
    return {
        **asdict(step),
        "autoencoder_steps": summary["steps_taken"],
        "autoencoder_r2": summary["r2_validation"],
        "validation_loss": [float(x) for x in trained.array("validation_loss")],
        "validation_steps": [int(x) for x in trained.array("validation_steps")],
        "cells": {
            cell: {key: errors[step.predictor]["mesh"][key] for key in ("r2", "mean_mm")}
            for cell, errors in cells.items()
            if "mesh" in errors.get(step.predictor, {})
        },
        "machine": trained.manifest["provenance"]["machine"],
    }


if __name__ == "__main__":
    run_as_process(DeparturesConfig, main)
