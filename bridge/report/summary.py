"""`results.json`: every number of a run, gathered from its stages' manifests."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from bridge.report.measured import Stages, measure, parameter_counts, validation_result
from bridge.report.paper_table import compare
from bridge.report.verification import verification

PREDICTOR_NAMES = {
    "dsnet": "DSNet",
    "dsnet_faithful": "DSNet, faithful reading",
    "autoencoder": "autoencoder alone (upper bound)",
    "mean_offset": "mean offset of the sequence",
    "smpl": "SMPL alone",
}


def summarise(stages: Stages, run_name: str, gender: str) -> dict[str, Any]:
    """The contents of `results.json`; lengths in millimetres where the key says so.

    `gender` is that of the run's body model.
    """
    evaluate = stages["evaluate"].manifest
    train_ae, train = stages["train-ae"].manifest, stages["train"].manifest
    summary = {
        "run": run_name,
        "data": stages["align"].origin,
        "parameters": parameter_counts(stages),
        "validation": validation_result(stages["evaluate"]),
        "splits": evaluate["splits"],
        "sequences": evaluate["per_sequence"],
        "alignment": evaluate["alignment"],
        "autoencoder": {
            "training": train_ae["autoencoder"],
            "pca": train_ae["pca"],
            "comparisons": train_ae.get("comparisons", []),
        },
        "dsnet": {
            "reading": stages["predict"].manifest["reading"],
            "readings": train["readings"],
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
    reading = stages["predict"].manifest["reading"]
    chosen = stages["train"].manifest["readings"][reading]
    if chosen["departs_from_paper"]:
        found.append(
            f"DSNet, reading `{reading}`: inputs and latents are standardised over the training "
            f"frames, and Adam's rate is {chosen['lr']:g}; the `faithful` reading stands beside it"
        )
    return found


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
