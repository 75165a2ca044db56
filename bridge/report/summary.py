"""`results.json`: every number of a run, gathered from its stages' manifests."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

from bridge.report.measured import Stages, measure, parameter_counts, validation_result
from bridge.report.paper_table import compare
from bridge.runs import Artifact

_FORWARD = ("layers", "loss", "losses")
_PACKAGES = {"torch": "torch", "keras": "keras", "onnx": "onnxruntime", "stream": "numpy"}


def summarise(stages: Stages, run_name: str, gender: str) -> dict[str, Any]:
    """The contents of `results.json`; lengths in millimetres where the key says so.

    `gender` is that of the run's body model.
    """
    evaluate = stages["evaluate"].manifest
    train_ae, train = stages["train-ae"].manifest, stages["train"].manifest
    summary = {
        "run": run_name,
        "predictors": evaluate["predictors"],
        "data": stages["align"].origin,
        "parameters": parameter_counts(stages),
        "validation": validation_result(stages["evaluate"]),
        "splits": evaluate["splits"],
        "sequences": evaluate["per_sequence"],
        "alignment": evaluate["alignment"],
        "autoencoder": {
            "training": _trained(stages) | {"error_fall": _error_fall(_trained(stages))},
            "pca": train_ae["pca"],
            "comparisons": train_ae.get("comparisons", []),
        },
        "dsnet": {
            "default": evaluate["default"],
            "predictors": train["predictors"],
            "epochs": train["config"]["epochs"],
            "parameters_trainable": train["parameters"].get("dsnet_trainable"),
        },
        "verification": verification(stages),
        "paper": [asdict(row) for row in compare(measure(stages, gender))],
        "stages": {name: _stage(artifact.manifest) for name, artifact in stages.items()},
    }
    return _without_nan(summary)


def departures(stages: Stages) -> list[str]:
    """Where the run leaves the paper's words, in its stages' own."""
    found = [f"autoencoder: {text}" for text in _trained(stages).get("departures", ())]
    for name, one in stages["train"].manifest["predictors"].items():
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
