"""`python -m benchmarks.alignment.downstream --out DIR`: what DSNet learns from each aligner.

Compares finished runs on one synthetic corpus that differ in the aligner only. All errors are
against the simulated truth: what is left between predicted and true mesh in the same pose, measured
at rest.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError
from bridge.exchange import Run
from bridge.exchange.artifact import write_text_atomically
from bridge.processes import run_as_process

_READINGS = {"dsnet": "standardised", "dsnet_faithful": "faithful"}
_SPLITS = {"validation": "held-out sequence", "test": "unseen motions"}
_TITLES = {"sgd": "the paper's SGD", "robust": "robust"}
_PAGE = """\
# DSNet's error by the aligner that it learned from (synthetic data)

{table}

Mean distance from the simulated truth in millimetres and, after the comma, R², whose 0 is SMPL
alone. Same corpus, seeds and settings but for the aligner; runs: {runs}. Made by `{command}`.
"""


@dataclass(frozen=True)
class DownstreamConfig:
    """Tabulate finished runs that differ in their aligner."""

    out: Path
    """Folder that receives downstream.json and downstream.md."""
    runs: tuple[str, ...] = ("demo", "demo_robust")
    """Runs that went as far as `evaluate`."""


def main(config: DownstreamConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If a run is not evaluated, or they differ in more than the aligner.
    """
    runs = {name: _described(Run(name)) for name in config.runs}
    _check_alike(runs)
    results = {
        "data": "synthetic",
        "runs": runs,
        "command": ["python", "-m", "benchmarks.alignment.downstream", *sys.argv[1:]],
    }
    config.out.mkdir(parents=True, exist_ok=True)
    write_text_atomically(config.out / "downstream.json", json.dumps(results, indent=1) + "\n")
    write_text_atomically(config.out / "downstream.md", markdown(results))
    return results


def markdown(results: dict[str, Any]) -> str:
    """A page with one table: a row for each aligner, and SMPL alone."""
    columns = [
        f"{title}, {reading}" for title in _SPLITS.values() for reading in _READINGS.values()
    ]
    lines = [
        f"| learned from | its offsets' R² | {' | '.join(columns)} |",
        "|---" + "|---:" * (len(columns) + 1) + "|",
    ]
    for run in results["runs"].values():
        cells = [_pair(run["errors"][s][p]) for s in _SPLITS for p in _READINGS]
        lines.append(
            f"| {_TITLES[run['aligner']]} | {run['offsets_r2']:.3f} | {' | '.join(cells)} |"
        )
    first = next(iter(results["runs"].values()))
    cells = [_pair(first["errors"][s]["smpl"]) for s in _SPLITS for _ in _READINGS]
    lines.append(f"| nothing: SMPL alone | | {' | '.join(cells)} |")
    return _PAGE.format(
        table="\n".join(lines),
        runs=", ".join(f"`{name}`" for name in results["runs"]),
        command=" ".join(results["command"]),
    )


def _described(run: Run) -> dict[str, Any]:
    evaluated, aligned = run.artifact("evaluate").manifest, run.artifact("align").manifest
    splits = evaluated["splits"]
    if not all("truth" in splits.get(split, {}) for split in _SPLITS):
        raise DsnetError(
            f"run {run.name!r} without errors against a truth",
            "a run on the synthetic corpus",
            "Make one with ./reproduce.sh --run NAME.",
        )
    kept = (*_READINGS, "autoencoder", "smpl")
    return {
        "aligner": aligned["config"]["aligner"],
        "corpus": aligned["upstream"]["corpus"],
        "settings": {s: run.artifact(s).manifest["config"] for s in ("train-ae", "train")},
        "offsets_r2": evaluated["alignment"]["offsets"]["r2"],
        "errors": {
            split: {name: error for name, error in splits[split]["truth"].items() if name in kept}
            for split in _SPLITS
        },
    }


def _check_alike(runs: dict[str, dict[str, Any]]) -> None:
    for key in ("corpus", "settings"):
        found = {json.dumps(run[key], sort_keys=True) for run in runs.values()}
        if len(found) > 1:
            raise DsnetError(
                f"runs {', '.join(runs)} that differ in their {key}",
                "runs that differ in the aligner only",
                "Make them with the same profile and seed.",
            )


def _pair(errors: dict[str, float]) -> str:
    return f"{errors['mean_mm']:.2f}, {errors['r2']:.2f}"


if __name__ == "__main__":
    run_as_process(DownstreamConfig, main)
