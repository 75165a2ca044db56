"""`python -m benchmarks.departures --run demo --out FILE`: what each departure buys.

Every autoencoder learns from the run's corpus for as many steps as its literal ones; DSNet learns
the latents and is measured like any run. A killed study goes on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import plugin
from benchmarks.departures.ladder import CODES, STEPS, Step
from benchmarks.processes import run_as_process, run_dsnet, run_module
from bridge.exchange.dsnet import AUTOENCODER, LATENTS_OF, LITERAL_DSNETS, CodeName
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import ALIGNMENT


@dataclass(frozen=True)
class DeparturesConfig:
    """Train and measure every step of the ladder."""

    out: Path
    """File for the results."""
    run: str = "demo"
    """Finished run, which has the literal predictors and DSNet+."""


def main(config: DeparturesConfig) -> None:
    plugin.use()
    source = Run(config.run)
    trained = source.artifact("train-ae")
    steps = trained.manifest["config"]["literal_steps"]
    epochs = source.artifact("train").manifest["config"]["predictors"]["dsnet_literal"]["epochs"]
    rows = {code: _of_code(source, code, steps, epochs) for code in CODES}
    rows[""] = [_row(source, step, epochs) for step in STEPS if not step.code]
    by_text = {row["text"]: row for of_code in rows.values() for row in of_code}
    results = {
        "data": trained.origin,
        "run": config.run,
        "machine": trained.manifest["provenance"]["machine"],
        "rows": [by_text[step.text] for step in STEPS],
    }
    write_text_atomically(config.out, json.dumps(results, indent=1) + "\n")


def _of_code(source: Run, code: str, steps: int, epochs: int) -> list[dict[str, Any]]:
    """Rows of the steps with one code."""
    run, here = Run(f"{source.name}-{code}"), [step for step in STEPS if step.code == code]
    same = CODES[code].aligner == "sgd"
    _link(source, run, ("corpus", "truth", *([ALIGNMENT] if same else [])))
    if not same:
        run_dsnet("align", "--run", run.name, "--aligner", CODES[code].aligner)
    autoencoder = ("--run", run.name, "--code", code, "--steps", str(steps))
    run_module("benchmarks.departures.autoencoder", *autoencoder)
    return _predicted(run, here, epochs)


def _predicted(run: Run, steps: Sequence[Step], epochs: int) -> list[dict[str, Any]]:
    learned_from = run.artifact("train-ae").content_sha256[:12]
    kept = run.path / f"departures-{learned_from}-{epochs}.json"
    if not kept.exists():
        names = [step.predictor for step in steps]
        run_dsnet("train", "--run", run.name, "--epochs", str(epochs), "--predictors", *names)
        for stage in ("infer", "decode", "evaluate"):
            run_dsnet(stage, "--run", run.name)
        rows = [_row(run, step, epochs) for step in steps]
        write_text_atomically(kept, json.dumps(rows) + "\n")
        shutil.rmtree(run.path / "decode")  # gigabytes
    return json.loads(kept.read_text(encoding="utf-8"))


def _link(source: Run, run: Run, stages: Sequence[str]) -> None:
    run.path.mkdir(parents=True, exist_ok=True)
    for stage in stages:
        if (source.path / stage).exists() and not (run.path / stage).exists():
            (run.path / stage).symlink_to(Path("..") / source.path.name / stage)


def _row(run: Run, step: Step, epochs: int) -> dict[str, Any]:
    trained = run.artifact("train-ae").manifest
    code = _code_of(step.predictor)
    summary = trained[code]
    cells = run.artifact("evaluate").manifest["cells"]
    latents = run.artifact("encode").array(LATENTS_OF[code])
    mean = latents.mean(axis=0)
    return {
        **asdict(step),
        "epochs": epochs,
        "autoencoder_steps": summary["steps_taken"],
        "autoencoder_r2": summary["r2_validation"],
        "latents_mean": float(np.linalg.norm(mean)),
        "latents_deviation": float(np.linalg.norm(latents - mean, axis=1).mean()),
        "cells": {
            cell: {key: errors[step.predictor]["mesh"][key] for key in ("r2", "mean_mm")}
            for cell, errors in cells.items()
            if "mesh" in errors.get(step.predictor, {})
        },
    }


def _code_of(predictor: str) -> CodeName:
    for code, literal in LITERAL_DSNETS.items():
        if literal == predictor:
            return code
    return AUTOENCODER


if __name__ == "__main__":
    run_as_process(DeparturesConfig, main)
