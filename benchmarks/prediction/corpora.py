"""The corpora of the test bed, and the `dsnet` commands that bring a run to its scores."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import plugin
from benchmarks.processes import run_dsnet
from bridge.errors import DsnetError
from bridge.exchange.dsnet import DMPL
from bridge.motion.splits import CELLS
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically

CORPORA: dict[str, tuple[str, ...]] = {
    "own": (),
    "second": ("--tissue", "second"),
    "third": ("--tissue", "third"),
    "captured": ("--tissue", "second", "--form", "captured"),
    "own_captured": ("--form", "captured"),
    "male": ("--gender", "male"),
    "male_second": ("--gender", "male", "--tissue", "second"),
}
"""Options of `dsnet corpus`. docs/prediction.md says what was seen of each law."""


def check_names(names: Sequence[str], known: Sequence[str], what: str) -> None:
    """Refuse names that are not known, or none.

    Raises
    ------
    DsnetError
        If there is one.
    """
    if not names or not set(names) <= set(known):
        raise DsnetError(
            f"{what} {' '.join(names) or '(none)'}",
            f"some of {', '.join(known)}",
            "Check the names.",
        )


def registered() -> tuple[str, ...]:
    """Every predictor of `dsnet train`, plugins' too, for which no licensed file is needed.

    Asked of a process of its own: frameworks that meet in one have crashed by order of import.
    """
    ask = (
        "from tf_dsnet.predictors import registered_predictors; "
        f"print(*(n for n, one in registered_predictors().items() if one.code != {DMPL!r}))"
    )
    plugin.use()
    done = subprocess.run(
        [sys.executable, "-c", ask], check=True, stdout=subprocess.PIPE, text=True
    )
    return tuple(done.stdout.split())


def prepare(
    run: str, profile: str, corpus: str, amass: Path | None, **real_motions: float | str | None
) -> None:
    """Make a corpus and align it with the robust aligner; what is current is kept.

    `real_motions` are the options of `dsnet corpus` about those of `amass`, such as `amass_fps`.
    """
    real = () if amass is None else ("--amass", str(amass))
    for name, value in real_motions.items():
        if value is not None:
            real += (f"--{name.replace('_', '-')}", str(value))
    dsnet("corpus", run, profile, *CORPORA[corpus], *real)
    dsnet("align", run, profile, "--aligner", "robust")


def prepare_dsnet(run: str, profile: str) -> None:
    """The autoencoder and its codes, which all of DSNet's seeds share."""
    dsnet("train-ae", run, profile)
    dsnet("encode", run, profile)


def train_dsnet(run: str, profile: str, seed: int, names: Sequence[str], epochs: int) -> None:
    """The named predictors on the robust aligner's offsets."""
    effort = ("--seed", str(seed), "--epochs", str(epochs))
    dsnet("train", run, profile, *effort, "--predictors", *names)
    dsnet("infer", run, profile)
    dsnet("decode", run, profile)


def train_plus(run: str, profile: str, seed: int) -> None:
    """`dsnet_plus` and its predictions."""
    dsnet("train", run, profile, "--seed", str(seed), "--predictors", "dsnet_plus")
    dsnet("infer", run, profile)


def scores(run: str, profile: str) -> dict[str, Any]:
    """Evaluate, and give back what the page needs of it."""
    dsnet("evaluate", run, profile)
    artifacts = Run(run).artifacts("evaluate", "train_plus")
    trained = artifacts["train_plus"].manifest
    return {
        **scores_of(artifacts["evaluate"]),
        "static": trained["static"],
        "train_s": trained["provenance"]["wall_time_s"],
    }


def scores_of(evaluated: Artifact) -> dict[str, Any]:
    """What the page needs of an evaluation."""
    found = evaluated.manifest
    return {
        "cells": found["cells"],
        "labels": found["predictors"],
        "test_bed": found["test_bed"],
        "alignments": found["alignments"],
        "sequences": [_kept_of(one) for one in found["per_sequence"] if one["cell"] in CELLS],
    }


def score_files(folder: Path) -> list[Path]:
    """Scores <corpus>-<seed>.json in a folder, by corpus and seed."""
    order = {name: place for place, name in enumerate(CORPORA)}
    found = [path for path in folder.glob("*-*.json") if path.stem.rsplit("-", 1)[0] in order]
    return sorted(found, key=lambda path: (order[path.stem.rsplit("-", 1)[0]], path.stem))


def write_index(path: Path, module: str) -> dict[str, Any]:
    """Write which command made the folder's scores, and which they are; also returns it."""
    index = {
        "command": " ".join(["python", "-m", module, *sys.argv[1:]]),
        "scores": [score.name for score in score_files(path.parent)],
    }
    write_text_atomically(path, json.dumps(index, indent=1) + "\n")
    return index


def read_index(path: Path) -> tuple[list[dict[str, Any]], str]:
    """The scores that an index names, and the command."""
    index = json.loads(path.read_text(encoding="utf-8"))
    return [
        json.loads((path.parent / name).read_text(encoding="utf-8")) for name in index["scores"]
    ], index["command"]


def _kept_of(sequence: Mapping[str, Any]) -> dict[str, Any]:
    kept = ("offsets", "moving", "velocity", "mesh")
    errors = {
        name: {kind: found[kind] for kind in kept if kind in found}
        for name, found in sequence["errors"].items()
    }
    return {**{key: sequence[key] for key in ("name", "cell", "frames")}, "errors": errors}


def dsnet(command: str, run: str, profile: str, *options: str) -> None:
    """One `dsnet` command in a process of its own.

    Raises
    ------
    SystemExit
        If it fails; it has said why.
    """
    plugin.use()
    run_dsnet(command, "--profile", profile, "--run", run, *options)
