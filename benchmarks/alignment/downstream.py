"""`python -m benchmarks.alignment.downstream --out DIR`: what DSNet learns from what it is given.

Compares finished runs on synthetic data that differ in the aligner only, or in the corpus only. All
errors are those of posed meshes: of the held-out sequence against the registered mesh, of unseen
motions against the simulation's true mesh.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from bridge.errors import DsnetError
from bridge.motion import sequences_of
from bridge.runs import Run
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process

_BESIDE = ("person_mean", "smpl")
_SPLITS = {"validation": "held-out sequence", "test": "unseen motions"}
_TITLES = {"sgd": "the paper's SGD", "robust": "robust"}
_PAGE = """\
# DSNet's error by the {varies} that it learned from (synthetic data)

{table}

Mean distance from the reference mesh in millimetres and, after the comma, R², whose 0 is SMPL alone
with the shape and pose that the predictor was given; those are the aligner's where it fitted them.
Same seeds and settings but for the {varies}; runs: {runs}. Made by `{command}`.
"""


@dataclass(frozen=True)
class DownstreamConfig:
    """Tabulate finished runs that differ in one thing."""

    out: Path
    """Folder that receives by_aligner.json and by_aligner.md, or by_corpus.*."""
    runs: tuple[str, ...] = ("demo", "demo_robust")
    """Runs that went as far as `evaluate`."""
    varies: Literal["aligner", "corpus"] = "aligner"
    """In what they differ."""


def main(config: DownstreamConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If a run is not evaluated, or they differ in more than that.
    """
    runs = {name: _described(Run(name)) for name in config.runs}
    _check_alike(runs, config.varies)
    results = {
        "data": "synthetic",
        "varies": config.varies,
        "runs": runs,
        "command": ["python", "-m", "benchmarks.alignment.downstream", *sys.argv[1:]],
    }
    config.out.mkdir(parents=True, exist_ok=True)
    path = config.out / f"by_{config.varies}"
    write_text_atomically(path.with_suffix(".json"), json.dumps(results, indent=1) + "\n")
    write_text_atomically(path.with_suffix(".md"), markdown(results))
    return results


def markdown(results: dict[str, Any]) -> str:
    """A page with one table: a row for each run."""
    labels = next(iter(results["runs"].values()))["predictors"]
    columns = [f"{title}, {label}" for title in _SPLITS.values() for label in labels.values()]
    lines = [
        f"| learned from | its offsets' R² | {' | '.join(columns)} |",
        "|---" + "|---:" * (len(columns) + 1) + "|",
    ]
    for run in results["runs"].values():
        title = _TITLES[run["aligner"]] if results["varies"] == "aligner" else run["learned_from"]
        cells = [_pair(run["errors"][s][p]) for s in _SPLITS for p in labels]
        lines.append(f"| {title} | {run['offsets_r2']:.3f} | {' | '.join(cells)} |")
    return _PAGE.format(
        varies=results["varies"],
        table="\n".join(lines),
        runs=", ".join(f"`{name}`" for name in results["runs"]),
        command=" ".join(results["command"]),
    )


def _described(run: Run) -> dict[str, Any]:
    evaluated, aligned = run.artifact("evaluate").manifest, run.artifact("align").manifest
    trained = run.artifact("train").manifest["predictors"]
    names = (*trained, *_BESIDE)
    cells = {split: evaluated["cells"].get(split, {}) for split in _SPLITS}
    if not all("mesh" in cell.get(name, {}) for cell in cells.values() for name in names):
        raise DsnetError(
            f"run {run.name!r} without errors against a truth",
            "a run on the synthetic corpus",
            "Make one with ./reproduce.sh --run NAME.",
        )
    learned = [s for s in sequences_of(run.artifact("align")) if s.split == "train"]
    return {
        "predictors": {name: evaluated["predictors"][name] for name in names},
        "aligner": aligned["config"]["aligner"],
        "corpus": aligned["upstream"]["corpus"],
        "learned_from": (
            f"{len({s.motion for s in learned})} motions, {len(learned)} sequences,"
            f" {sum(s.length for s in learned)} frames"
        ),
        "settings": {s: run.artifact(s).manifest["config"] for s in ("train-ae", "train")},
        "offsets_r2": evaluated["alignment"]["offsets"]["r2"],
        "errors": {
            split: {name: cell[name]["mesh"] for name in names} for split, cell in cells.items()
        },
    }


def _check_alike(runs: dict[str, dict[str, Any]], varies: str) -> None:
    for key in ("corpus", "aligner", "settings", "predictors"):
        if key == varies:
            continue
        found = {json.dumps(run[key], sort_keys=True) for run in runs.values()}
        if len(found) > 1:
            raise DsnetError(
                f"runs {', '.join(runs)} that differ in their {key}",
                f"runs that differ in the {varies} only",
                "Make them with the same profile and seed.",
            )


def _pair(errors: dict[str, float]) -> str:
    return f"{errors['mean_mm']:.2f}, {errors['r2']:.2f}"


if __name__ == "__main__":
    run_as_process(DownstreamConfig, main)
