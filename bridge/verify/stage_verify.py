"""`dsnet verify`: the engines compute the same, or the command fails.

PyTorch and Keras are compared with the NumPy reference in layers, losses, gradients, training
steps, SMPL and files; ONNX in float32 forward passes of both networks, in files, and in the graphs
that are exported, from poses to the posed skin; the streaming predictor in its latents.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError
from bridge.options import Seed
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import body_model_path
from bridge.verify import tolerances
from bridge.verify.checks import Plan
from bridge.verify.compare import Row
from bridge.verify.engines import Answer
from bridge.verify.faults import FaultName, faulty_cases, shown_by_torch
from bridge.verify.findings import diagnose, summary, text_table
from bridge.verify.random_checks import full_size_plan, random_plan
from bridge.verify.runner import verify
from bridge.verify.trained_checks import trained_plan

STAGE = "verify"
EMBEDDED_BODY = "embedded:female"


@dataclass(frozen=True)
class VerifyConfig:
    """Compare PyTorch and Keras with a float64 reference: layers, gradients, steps, SMPL, files;
    and ONNX with it in float32 forward passes.

    Every engine is a process of its own, one after the other. Prints a table, writes `parity.json`;
    exits with 1 when anything differs by more than its tolerance.
    """

    run: str = "demo"
    """Run whose trained weights and motions are compared beside random ones."""
    seed: Seed = 0
    """Seed of the random weights and inputs."""
    trained: bool = True
    """Compare the run's trained weights; without them no run needs to be there."""
    full_size: bool = True
    """Compare the autoencoder of random weights at its 33,626,606 parameters."""
    inject: FaultName | None = None
    """Make this mistake in PyTorch's engine: shows that it is found. Nothing is written."""


PROFILES = {
    "smoke": VerifyConfig(run="smoke", full_size=False),
    "demo": VerifyConfig(run="demo"),
    "paper": VerifyConfig(run="paper"),
}


def main(config: VerifyConfig) -> None:
    """Compare, print, write; nothing is ever skipped because it was done before.

    Raises
    ------
    DsnetError
        If there is no such run.
    SystemExit
        With status 1 if a row failed.
    """
    run = Run(config.run)
    if config.inject:
        with tempfile.TemporaryDirectory(prefix="dsnet-") as scratch:
            rows = _find_fault(config.inject, config.seed, Path(scratch))
    else:
        _check_run(config, run)
        rows = _make(config, run)
    sys.exit(0 if all(row.passed for row in rows) else 1)


def _check_run(config: VerifyConfig, run: Run) -> None:
    if config.trained and not run.path.is_dir():
        raise DsnetError(
            f"unknown run {config.run!r}",
            f"a run in {run.path.parent}",
            "Run ./reproduce.sh first, or pass --no-trained to compare random weights.",
        )


def _find_fault(name: FaultName, seed: int, folder: Path) -> list[Row]:
    plan = shown_by_torch(random_plan(seed, EMBEDDED_BODY))
    cases = faulty_cases(plan, name, folder / "request")
    rows, _answers = verify(plan, folder, cases)
    _print(rows)
    return rows


def _make(config: VerifyConfig, run: Run) -> list[Row]:
    with run.alone(STAGE):
        return _make_alone(config, run)


def _make_alone(config: VerifyConfig, run: Run) -> list[Row]:
    sources = _sources(config, run)
    origin = sources["align"].origin if "align" in sources else "synthetic"
    # A fresh writer each time: what is asked is whether they agree now.
    writer = ArtifactWriter(run.path / STAGE, STAGE, data=origin)
    try:
        plan = plan_of(config, run)
        started = time.perf_counter()
        rows, answers = verify(plan, writer.checkpoints / "work")
    except BaseException:  # an interrupt, too: there is nothing to go on from
        writer.discard()
        raise
    writer.record_measured(
        engines_s=round(time.perf_counter() - started, 2),
        seconds={name: round(sum(a.seconds.values()), 2) for name, a in answers.items()},
    )
    text = json.dumps(parity(rows, answers), indent=1, allow_nan=False) + "\n"
    writer.file_path("parity.json").write_text(text, encoding="utf-8")
    settings = {key: value for key, value in asdict(config).items() if key != "run"}
    upstream = {name: source.content_sha256 for name, source in sources.items()}
    writer.finish(config=settings, upstream=upstream)
    _print(rows)
    return rows


def plan_of(config: VerifyConfig, run: Run) -> Plan:
    """All checks for a run."""
    plan = random_plan(config.seed, _body(run))
    if config.full_size:
        plan = plan + full_size_plan(config.seed)
    return plan + trained_plan(run) if config.trained else plan


def parity(rows: Sequence[Row], answers: Mapping[str, Answer]) -> dict[str, Any]:
    """The contents of `parity.json`; what is infinite is null."""
    limits = {
        name: asdict(value)
        for name, value in vars(tolerances).items()
        if isinstance(value, tolerances.Tolerance)
    }
    return {
        "passed": all(row.passed for row in rows),
        "diagnosis": diagnose(rows),
        "tolerances": limits,
        "engines": {name: dict(answer.versions) for name, answer in answers.items()},
        "rows": [
            {key: None if value == float("inf") else value for key, value in asdict(row).items()}
            for row in rows
        ],
    }


def _print(rows: Sequence[Row]) -> None:
    sys.stdout.write(f"{text_table(rows)}\n\n{summary(rows, diagnose(rows))}\n")


def _body(run: Run) -> str:
    """The run's own body model, or the embedded one before anything was aligned."""
    return str(body_model_path(run)) if run.finished("align") else EMBEDDED_BODY


def _sources(config: VerifyConfig, run: Run) -> dict[str, Artifact]:
    """The stages whose results are compared, those that there are."""
    trained = ("encode", "train-ae", "train", "train_plus") if config.trained else ()
    return {stage: run.artifact(stage) for stage in ("align", *trained) if run.finished(stage)}
