"""Rivals beside the comparison's systems: scores that `python -m benchmarks.rivals` left there.

A rival is not trained, so that one score of a corpus holds for every training seed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError

_OF_SEQUENCE = ("name", "cell", "frames")


def rival_path(folder: Path, corpus: str, rival: str) -> Path:
    """Where the scores of a rival on a corpus lie."""
    return folder / f"rivals-{corpus}-{rival}.json"


def with_rivals(folder: Path, scores: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The comparison's scores, each with the rivals of its corpus.

    Raises
    ------
    DsnetError
        If a rival was scored on other clips.
    """
    rivals = _rivals(folder, scores)
    merged = []
    for score in scores:
        found = dict(score)
        for path, rival in rivals.items():
            if rival["corpus"] == score["corpus"]:
                _refuse_others(path, rival, score)
                found = _with(found, rival)
        merged.append(found)
    return merged


def commands_of_rivals(folder: Path, scores: Sequence[Mapping[str, Any]]) -> list[str]:
    """The commands that made the rivals' scores."""
    return [rival["command"] for rival in _rivals(folder, scores).values()]


def _rivals(folder: Path, scores: Sequence[Mapping[str, Any]]) -> dict[Path, dict[str, Any]]:
    corpora = dict.fromkeys(score["corpus"] for score in scores)
    paths = [
        path for one in corpora for path in sorted(folder.glob(rival_path(folder, one, "*").name))
    ]
    return {path: json.loads(path.read_text(encoding="utf-8")) for path in paths}


def _refuse_others(path: Path, rival: Mapping[str, Any], score: Mapping[str, Any]) -> None:
    for key, other in _identity(score).items():
        if _identity(rival)[key] != other:
            raise DsnetError(
                f"{path} with other {key} than {score['corpus']}-{score['seed']}.json",
                "the same clips",
                "Run the rival again on the comparison's run, or delete its score.",
            )


def _identity(score: Mapping[str, Any]) -> dict[str, Any]:
    sequences = [[one[part] for part in _OF_SEQUENCE] for one in score["sequences"]]
    return {"test_bed": score["test_bed"], "sequences": sequences}


def _with(score: Mapping[str, Any], rival: Mapping[str, Any]) -> dict[str, Any]:
    """A score with one more system."""
    name = rival["rival"]
    cells = {c: one | {name: rival["cells"][c][name]} for c, one in score["cells"].items()}
    sequences = [
        own | {"errors": own["errors"] | {name: one["errors"][name]}}
        for own, one in zip(score["sequences"], rival["sequences"], strict=True)
    ]
    shown, sizes = score["over_time"], rival["over_time"]
    if name in sizes.get("mm", {}) and shown.get("sequence") == sizes["sequence"]:
        shown = shown | {"mm": shown["mm"] | {name: sizes["mm"][name]}}
    return dict(score) | {
        "cells": cells,
        "sequences": sequences,
        "over_time": shown,
        "labels": score["labels"] | {name: rival["labels"][name]},
        "systems": score["systems"] | rival["systems"],
    }
