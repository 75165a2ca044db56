"""`python -m benchmarks.prediction.comparison --out DIR`: every system, side by side.

On each corpus all predictors of the registry, `dsnet_plus` and what learns nothing are given the
same aligned offsets, trained with each seed and scored against the truth. What is finished is
kept: a score is a file of its own, and runs are made by `dsnet`, which resumes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.prediction.comparison_clips import draw_clips
from benchmarks.prediction.comparison_figures import draw_figures
from benchmarks.prediction.comparison_page import FIGURES, page
from benchmarks.prediction.comparison_rivals import commands_of_rivals, with_rivals
from benchmarks.prediction.corpora import (
    CORPORA,
    check_names,
    prepare,
    prepare_dsnet,
    read_index,
    registered,
    score_files,
    scores,
    train_dsnet,
    train_plus,
    write_index,
)
from bridge.errors import DsnetError
from bridge.measure.stage_evaluate import TRUE, offset_sizes_m
from bridge.motion.cells import CELLS
from bridge.runs import Artifact, Run
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process

_INDEX = "comparison.json"
_SAME = ("profile", "epochs", "test_bed", "sequences")
"""What scores of one corpus have in common."""


@dataclass(frozen=True)
class ComparisonConfig:
    """Make what is missing, and write the page and its figures.

    One corpus with one seed in profile demo is the quick comparison.
    """

    out: Path
    """Folder that receives a score a file, comparison.json and figures; beside it lies the page,
    of the same name with .md."""
    corpora: tuple[str, ...] = ("own",)
    """Which corpora of the test bed."""
    seeds: tuple[int, ...] = (0,)
    """Training seeds."""
    systems: tuple[str, ...] = ()
    """Which predictors of `dsnet train`, all if none is named; `dsnet_plus` and what learns nothing
    are always there."""
    epochs: int = 500
    """Of every predictor of `dsnet train`; those that search spend a part of them on it."""
    profile: str = "demo"
    """Sizes: smoke, demo or paper."""
    amass: Path | None = None
    """Folder of AMASS files that become test motions too."""
    prefix: str = "compared"
    """Runs are named <prefix>_<corpus>."""


def main(config: ComparisonConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If a corpus or system is unknown, or scores in the folder are of another corpus or effort.
    """
    check_names(config.corpora, tuple(CORPORA), "corpora")
    if config.systems:
        check_names(config.systems, registered(), "systems")
    config.out.mkdir(parents=True, exist_ok=True)
    refuse_mixture(config.out)
    for corpus in config.corpora:
        _score(config, corpus)
    results = write_index(config.out / _INDEX, "benchmarks.prediction.comparison")
    scores = with_rivals(config.out, read_index(config.out / _INDEX)[0])
    draw_figures(config.out, scores)
    _draw_clips(config, scores)
    write_text_atomically(page_path(config.out), markdown(config.out))
    return results


def markdown(folder: Path) -> str:
    """The page, of the folder's scores."""
    scores, command = read_index(folder / _INDEX)
    commands = [command, *commands_of_rivals(folder, scores)]
    figures = [name for name in FIGURES if (folder / name).exists()]
    return page(with_rivals(folder, scores), commands, folder.name, figures)


def page_path(folder: Path) -> Path:
    """Where the folder's page is."""
    return folder.with_name(f"{folder.name}.md")


def refuse_mixture(folder: Path) -> None:
    """Scores of one corpus have to be of the same data and effort.

    Raises
    ------
    DsnetError
        That names the first difference.
    """
    first: dict[str, tuple[Path, dict[str, Any]]] = {}
    for path in score_files(folder):
        score = json.loads(path.read_text(encoding="utf-8"))
        known, other = first.setdefault(score["corpus"], (path, score))
        for key in _SAME:
            if _identity(score, key) != _identity(other, key):
                raise DsnetError(
                    f"{path} with other {key} than {known.name}",
                    f"the same corpus, splits and effort ({', '.join(_SAME)})",
                    "Delete one of the two, or write to another --out.",
                )


def _identity(score: Mapping[str, Any], key: str) -> Any:
    if key != "sequences":
        return score[key]
    return [[one[part] for part in ("name", "cell", "frames")] for one in score[key]]


def _score(config: ComparisonConfig, corpus: str) -> None:
    run, ready = f"{config.prefix}_{corpus}", False
    for seed in config.seeds:
        path = config.out / f"{corpus}-{seed}.json"
        if path.exists():
            continue
        if not ready:
            prepare(run, config.profile, corpus, config.amass)
            prepare_dsnet(run, config.profile)
            ready = True
        train_dsnet(run, config.profile, seed, config.systems or registered(), config.epochs)
        train_plus(run, config.profile, seed)
        found = {
            "corpus": corpus,
            "seed": seed,
            "profile": config.profile,
            "epochs": config.epochs,
            **short(scores(run, config.profile)),
            "systems": _systems(run),
            "over_time": sizes_over_time(Run(run).artifact("evaluate")),
        }
        write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")


def short(found: Mapping[str, Any]) -> dict[str, Any]:
    """Of the scores what the page shows."""
    cells = {cell: errors for cell, errors in found["cells"].items() if cell in CELLS}
    return {
        "labels": found["labels"],
        "test_bed": found["test_bed"],
        "cells": {
            cell: {name: _numbers(one) for name, one in errors.items()}
            for cell, errors in cells.items()
        },
        "sequences": [
            {
                **{key: one[key] for key in ("name", "cell", "frames")},
                "errors": {name: _numbers(error) for name, error in one["errors"].items()},
            }
            for one in found["sequences"]
        ],
    }


def _numbers(errors: Mapping[str, Any]) -> dict[str, float]:
    kept = {
        "r2": ("offsets", "r2"),
        "rms_mm": ("offsets", "rms_mm"),
        "velocity_r2": ("velocity", "r2"),
        "mesh_mean_mm": ("mesh", "mean_mm"),
        "mesh_p95_mm": ("mesh", "p95_mm"),
    }
    return {
        short: round(errors[metric][key], 5)
        for short, (metric, key) in kept.items()
        if metric in errors and key in errors[metric]
    }


def _draw_clips(config: ComparisonConfig, scores: Sequence[Mapping[str, Any]]) -> None:
    """Of the first corpus's run, if it is still there: a score is not enough to draw bodies."""
    path, corpus = config.out / "clips.png", config.corpora[0]
    run = Run(f"{config.prefix}_{corpus}")
    shown = [s["over_time"] for s in scores if s["corpus"] == corpus]
    if not path.exists() and shown and run.finished("evaluate"):
        draw_clips(path, run, shown[0]["sequence"])


def _systems(run: str) -> dict[str, dict[str, Any]]:
    """What each trained predictor learned, its size and its rate."""
    kept = ("label", "code", "parameters", "lr", "departures")
    trained = Run(run).artifact("train").manifest["predictors"]
    return {name: {key: entry[key] for key in kept} for name, entry in trained.items()}


def sizes_over_time(evaluated: Artifact) -> dict[str, Any]:
    """Size of the offsets in each frame of one motion that is new to all: a real one if any."""
    unseen = [s for s in evaluated.manifest["per_sequence"] if s["cell"] == list(CELLS)[-1]]
    if not unseen:
        return {}
    shown = next((s for s in unseen if "_amass_" in s["name"]), unseen[0])["name"]
    sizes = {
        name: offset_sizes_m(evaluated, name, shown)
        for name in (TRUE, *evaluated.manifest["predictors"])
    }
    in_mm = {n: np.round(1e3 * s, 3).tolist() for n, s in sizes.items() if s is not None}
    return {"sequence": shown, "mm": in_mm}


if __name__ == "__main__":
    run_as_process(ComparisonConfig, main)
