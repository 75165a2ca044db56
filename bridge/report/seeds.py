"""Trainings from several seeds: a run, and the runs `<run>-seed<N>` beside it that learn from the
same alignment."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from bridge.errors import notify
from bridge.runs import Artifact, Run
from bridge.runs.artifact import read_artifact
from bridge.runs.run import ALIGNMENT, ROBUST_ALIGNMENT

_SHARED = ("truth", ALIGNMENT, ROBUST_ALIGNMENT)
_SPREAD = (("offsets", "r2"), ("mesh", "r2"), ("mesh", "mean_mm"))


def of_other_seeds(run: Run, evaluate: Artifact) -> dict[int, Artifact]:
    """`evaluate` of the runs of other seeds, by seed; who left the run's alignment is left out."""
    found: dict[int, Artifact] = {}
    for path in run.path.parent.iterdir():
        named = re.fullmatch(re.escape(run.name) + r"-seed([0-9]+)", path.name)
        if named and Run(path.name).finished("evaluate"):
            other = read_artifact(path / "evaluate")
            upstreams = [one.manifest["upstream"] for one in (evaluate, other)]
            ours, its = ([upstream.get(name) for name in _SHARED] for upstream in upstreams)
            if ours == its:
                found[int(named[1])] = other
            else:
                notify(
                    f"left out: run {path.name!r}, which is of another alignment than {run.name!r}"
                )
    return dict(sorted(found.items()))


def spread_over(
    cells: Iterable[Mapping[str, Any]], predictors: Iterable[str]
) -> dict[str, dict[str, dict[str, dict[str, dict[str, float]]]]]:
    """Mean and standard deviation (of a sample) over seeds of what each of these `cells`, by seed,
    measured: by test group, predictor, reference and number, as in each of them."""
    first, *others = cells
    spread: dict[str, Any] = {}
    for cell, of_predictors in first.items():
        for name in predictors:
            for reference, number in _SPREAD:
                every = [
                    one.get(cell, {}).get(name, {}).get(reference, {}).get(number)
                    for one in ({cell: of_predictors}, *others)
                ]
                if None not in every:
                    own = spread.setdefault(cell, {}).setdefault(name, {})
                    own.setdefault(reference, {})[number] = {
                        "mean": float(np.mean(every)),
                        "sd": float(np.std(every, ddof=1)),
                    }
    return spread
