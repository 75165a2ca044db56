"""`python -m benchmarks.prediction.comparison --out DIR`: every system, side by side.

On each corpus all predictors of the registry, `dsnet_plus` and what learns nothing are given the
same aligned offsets, trained with each seed and scored against the truth. What is finished is
kept: a score is a file of its own, and runs are made by `dsnet`, which resumes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.prediction.comparison_figures import draw_figures
from benchmarks.prediction.comparison_page import FIGURES, page
from benchmarks.prediction.comparison_rivals import commands_of_rivals, with_rivals
from benchmarks.prediction.comparison_scores import joined, refuse_mixture, score
from benchmarks.prediction.corpora import (
    CORPORA,
    check_names,
    prepare,
    prepare_dsnet,
    read_index,
    registered,
    train_dsnet,
    train_plus,
    write_index,
)
from benchmarks.processes import run_as_process
from bridge.runs.files import write_text_atomically

_INDEX = "comparison.json"


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
    are always there. Those that a score lacks are trained and join it."""
    epochs: int = 500
    """Of every predictor of `dsnet train`; those that search spend a part of them on it."""
    profile: str = "demo"
    """Sizes: smoke, demo or paper."""
    amass: Path | None = None
    """Folder of AMASS files or BVHs that become test motions too."""
    amass_fps: float | None = None
    """Frames per second of these files, where what they say of themselves is wrong."""
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


def _score(config: ComparisonConfig, corpus: str) -> None:
    """Make what is missing of a corpus: a seed's scores, or some systems of them."""
    run, ready = f"{config.prefix}_{corpus}", False
    asked = config.systems or registered()
    for seed in config.seeds:
        path = config.out / f"{corpus}-{seed}.json"
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
        missing = [name for name in asked if kept is None or name not in kept["systems"]]
        if kept is not None and not missing:
            continue
        if not ready:
            prepare(run, config.profile, corpus, config.amass, amass_fps=config.amass_fps)
            prepare_dsnet(run, config.profile)
            ready = True
        train_dsnet(run, config.profile, seed, missing, config.epochs)
        if kept is None:
            train_plus(run, config.profile, seed)
        found = score(run, corpus, seed, config.profile, config.epochs)
        if kept is not None:
            found = joined(kept, found, missing, path.name)
        write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    run_as_process(ComparisonConfig, main)
