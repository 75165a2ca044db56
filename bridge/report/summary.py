"""`results.json`: every number of a run, gathered from its stages' manifests."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

from bridge.motion.splits import CELLS
from bridge.report.measured import Stages, measure, parameter_counts, validation_result
from bridge.report.paper_table import compare
from bridge.runs import Artifact
from bridge.runs.run import TRAIN_PLUS

_FORWARD = ("layers", "loss", "losses")
_PACKAGES = {"torch": "torch", "keras": "keras", "onnx": "onnxruntime", "stream": "numpy"}


def summarise(stages: Stages, run_name: str, gender: str) -> dict[str, Any]:
    """The contents of `results.json`; lengths in millimetres where the key says so.

    What belongs to the paper's road is None in a run that did not go it. `gender` is that of the
    run's body model.
    """
    evaluate = stages["evaluate"].manifest
    summary = {
        "run": run_name,
        "predictors": evaluate["predictors"],
        "default": evaluate["default"],
        "roads": evaluate["roads"],
        "data": stages["evaluate"].origin,
        "test_bed": evaluate["test_bed"],
        "validation": validation_result(stages["evaluate"]),
        "cells": evaluate["cells"],
        "cell_titles": cell_titles(stages["evaluate"]),
        "sequences": evaluate["per_sequence"],
        "alignment": evaluate["alignment"],
        "alignments": evaluate["alignments"],
        **_papers_road(stages, gender),
        "verification": verification(stages),
        "stages": {name: _stage(artifact.manifest) for name, artifact in stages.items()},
    }
    return _without_nan(summary)


def cell_titles(evaluate: Artifact) -> dict[str, str]:
    """Title of each measured cell, in the order of the tables."""
    validation = validation_result(evaluate)
    held_out = "" if validation is None else f", `{validation['name']}`"
    titles = {"validation": f"held out{held_out}"} | CELLS
    titles |= {"test": "all of the four cells", "train": "trained on (first of each person)"}
    return {cell: title for cell, title in titles.items() if cell in evaluate.manifest["cells"]}


def _papers_road(stages: Stages, gender: str) -> dict[str, Any]:
    """Networks of the paper's road and its numbers beside ours."""
    keys = ("parameters", "autoencoder", "dsnet", "paper")
    if "decode" not in stages:
        return dict.fromkeys(keys)
    train_ae, train = stages["train-ae"].manifest, stages["train"].manifest
    return {
        "parameters": parameter_counts(stages),
        "autoencoder": {
            "training": _trained(stages) | {"error_fall": _error_fall(_trained(stages))},
            "pca": train_ae["pca"],
            "comparisons": train_ae.get("comparisons", []),
        },
        "dsnet": {
            "default": stages["decode"].manifest["default"],
            "predictors": train["predictors"],
            "epochs": train["config"]["epochs"],
            "parameters_trainable": train["parameters"].get("dsnet_trainable"),
        },
        "paper": [asdict(row) for row in compare(measure(stages, gender))],
    }


def departures(stages: Stages) -> list[str]:
    """Where the run leaves the paper's words, in its stages' own."""
    found: list[str] = []
    if "train-ae" in stages:
        found += [f"autoencoder: {text}" for text in _trained(stages).get("departures", ())]
    for stage in ("train", TRAIN_PLUS):
        if stage in stages:
            for name, one in stages[stage].manifest["predictors"].items():
                found += [f"`{name}`: {text}" for text in one["departures"]]
    return found


def _error_fall(trained: dict[str, Any]) -> float:
    """Share of the initial squared error on validation frames that training took away."""
    return 1.0 - (1.0 - trained["r2_validation"]) / (1.0 - trained["r2_initial"])


def read_parity(verify: Artifact) -> dict[str, Any]:
    """The contents of `parity.json`."""
    return json.loads(verify.file("parity.json").read_text(encoding="utf-8"))


def verification(stages: Stages) -> dict[str, Any] | None:
    """Rows, those that hold, and the largest differences of each engine and precision."""
    if "verify" not in stages:
        return None
    parity = read_parity(stages["verify"])
    rows = parity["rows"]
    columns = dict.fromkeys((row["engine"], row["dtype"]) for row in rows)
    differentiated = {row["engine"] for row in rows if row["part"] == "gradients"}
    return {
        "forward_only": [engine for engine in parity["engines"] if engine not in differentiated],
        "rows": len(rows),
        "held": sum(row["passed"] for row in rows),
        "diagnosis": list(parity["diagnosis"]),
        "engines": [
            {
                "engine": engine,
                "version": parity["engines"][engine].get(_PACKAGES[engine], ""),
                "precision": dtype,
                "forward": _largest(rows, engine, dtype, forward=True),
                "backward": _largest(rows, engine, dtype, forward=False),
            }
            for engine, dtype in columns
        ],
    }


def _largest(rows: list[dict[str, Any]], engine: str, dtype: str, *, forward: bool) -> float | None:
    """The largest relative difference of one engine's rows, None without a number."""
    found = [
        row["max_rel"]
        for row in rows
        if (row["engine"], row["dtype"]) == (engine, dtype)
        and row["max_rel"] is not None
        and row["part"] != "files"
        and (row["part"] in _FORWARD) == forward
    ]
    return max(found, default=None)


_OF_EVERY_STAGE = {
    "command",
    "finished_utc",
    "machine",
    "peak_memory_mb",
    "sha256",
    "versions",
    "wall_time_s",
}


def _trained(stages: Stages) -> dict[str, Any]:
    return stages["train-ae"].manifest["autoencoder"]


def _stage(manifest: dict[str, Any]) -> dict[str, Any]:
    provenance = manifest["provenance"]
    measured = {key: value for key, value in provenance.items() if key not in _OF_EVERY_STAGE}
    return {
        "wall_time_s": provenance["wall_time_s"],
        "peak_memory_mb": provenance["peak_memory_mb"],
        "machine": provenance["machine"],
        "seed": manifest["config"].get("seed"),
        "versions": provenance["versions"],
        "config": manifest["config"],
        "measured": measured,
    }


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: a number that is not one becomes null."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
