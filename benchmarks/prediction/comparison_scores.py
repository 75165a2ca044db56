"""A score of the comparison: what one corpus and one seed gave for every system, one JSON file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.prediction.corpora import dsnet, score_files, scores_of
from bridge.errors import DsnetError
from bridge.motion.sequences import is_real_motion
from bridge.motion.splits import CELLS
from bridge.runs import Artifact, Run
from dsnet.evaluation.comparison import TRUE
from dsnet.evaluation.evaluation import OFFSET_SIZE, per_frame_m

_SAME = ("profile", "epochs", "test_bed", "sequences")
"""What scores of one corpus have in common."""
_SAME_MM = 1e-3
"""By so much a sequence's size may differ between machines."""


def score(run: str, corpus: str, seed: int, profile: str, epochs: int) -> dict[str, Any]:
    """Evaluate a run whose predictors were trained with a seed."""
    dsnet("evaluate", run, profile)
    evaluated = Run(run).artifact("evaluate")
    return {
        "corpus": corpus,
        "seed": seed,
        "profile": profile,
        "epochs": epochs,
        **short(scores_of(evaluated)),
        "systems": _systems(run),
        "over_time": sizes_over_time(evaluated),
    }


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
    shown = next((s for s in unseen if is_real_motion(s["name"])), unseen[0])["name"]
    sizes = {
        name: per_frame_m(evaluated, OFFSET_SIZE, name, shown)
        for name in (TRUE, *evaluated.manifest["predictors"])
    }
    in_mm = {n: np.round(1e3 * s, 3).tolist() for n, s in sizes.items() if s is not None}
    return {"sequence": shown, "mm": in_mm}


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


def joined(
    kept: Mapping[str, Any], found: Mapping[str, Any], names: Sequence[str], file: str
) -> dict[str, Any]:
    """A score with the named systems of another one of the same corpus, seed and effort.

    Raises
    ------
    DsnetError
        If they are not of the same data: what learns nothing has other errors there.
    """
    both = dict(kept)
    for key in (*_SAME, "corpus", "seed"):
        if _identity(found, key) != _identity(kept, key):
            raise _other_data(file, key)
    for old, new in zip(kept["sequences"], found["sequences"], strict=True):
        if abs(old["errors"]["smpl"]["rms_mm"] - new["errors"]["smpl"]["rms_mm"]) > _SAME_MM:
            raise _other_data(file, f"offsets of {old['name']}")
    both["labels"] = kept["labels"] | _only(found["labels"], names)
    both["systems"] = kept["systems"] | _only(found["systems"], names)
    both["cells"] = {
        cell: errors | _only(found["cells"][cell], names) for cell, errors in kept["cells"].items()
    }
    both["sequences"] = [
        {**old, "errors": old["errors"] | _only(new["errors"], names)}
        for old, new in zip(kept["sequences"], found["sequences"], strict=True)
    ]
    sizes = kept["over_time"]["mm"] | _only(found["over_time"]["mm"], names)
    both["over_time"] = {**kept["over_time"], "mm": sizes}
    return both


def _only(entries: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return {name: entries[name] for name in names if name in entries}


def _other_data(file: str, what: str) -> DsnetError:
    return DsnetError(
        f"other {what} than in {file}",
        "the data and effort of the systems that were scored before",
        "Write to another --out, which makes all anew.",
    )


def _identity(score: Mapping[str, Any], key: str) -> Any:
    if key != "sequences":
        return score[key]
    return [[one[part] for part in ("name", "cell", "frames")] for one in score[key]]
