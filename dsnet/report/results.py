"""What a report says: `results.json`, every number of a run's manifests."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

from bridge.errors import notify
from bridge.exchange.train_options import settings_of
from bridge.motion import sequences_of
from bridge.motion.splits import CELLS, kind_of
from bridge.runs import Artifact, Run
from bridge.runs.artifact import read_artifact
from bridge.runs.run import ALIGNMENT, INFER_PLUS, ROBUST_ALIGNMENT, TRAIN_PLUS
from dsnet.report.paper_table import (
    Stages,
    compare,
    measure,
    mosh_rate,
    parameter_counts,
    validation_result,
)

_MEASURED = ("predictors", "default", "pipelines", "test_bed", "cells", "alignments")
_FORWARD = ("layers", "loss", "losses")
_PACKAGES = {"torch": "torch", "keras": "keras", "onnx": "onnxruntime", "stream": "numpy"}
_OF_EVERY_STAGE = ("command", "finished_utc", "sha256", "stamps", "input_stamps")
_SHARED = ("truth", ALIGNMENT, ROBUST_ALIGNMENT)
"""By runs that learn the same from other seeds."""
_OF_EVERY_SEED = ("train", "infer", "decode", TRAIN_PLUS, INFER_PLUS, "evaluate")
_SPREAD = (("offsets", "r2"), ("mesh", "r2"), ("mesh", "mean_mm"))
_SHOWN_OF_STAGES = ("wall_time_s", "peak_memory_mb", "machine", "versions")


def summarise(
    stages: Stages, run_name: str, gender: str, others: Mapping[int, Artifact]
) -> dict[str, Any]:
    """The contents of `results.json`; lengths in millimetres where the key says so.

    What belongs to the paper's pipeline is None in a run without it. `gender` is that of the run's
    body model; `others` are `evaluate` of trainings from other seeds, by seed.
    """
    evaluate = stages["evaluate"].manifest
    validation = validation_result(stages["evaluate"])
    held_out = "" if validation is None else f", `{validation['name']}`"
    titles = {"validation": f"held out{held_out}"} | CELLS
    titles |= {"test": "all of the four test groups", "train": "trained on (first of each person)"}
    summary = {
        "run": run_name,
        "data": stages["evaluate"].origin,
        **{key: evaluate[key] for key in _MEASURED},
        "seeds": _of_seeds(stages, others) if others else None,
        "table_1": _table_1(stages),
        "cell_titles": {key: text for key, text in titles.items() if key in evaluate["cells"]},
        "sequences": evaluate["per_sequence"],
        **_papers_pipeline(stages, gender),
        "verification": verification(stages),
        "stages": {name: _stage(artifact.manifest) for name, artifact in stages.items()},
        "seeds_took_s": {str(seed): _took_s(other) for seed, other in others.items()},
    }
    # JSON has no NaN: a number that is not one becomes null.
    return json.loads(json.dumps(summary), parse_constant=lambda _: None)


def _papers_pipeline(stages: Stages, gender: str) -> dict[str, Any]:
    """Networks of the paper's pipeline and its numbers beside ours."""
    if "decode" not in stages:
        return dict.fromkeys(("parameters", "autoencoder", "paper"))
    train_ae = stages["train-ae"].manifest
    trained = train_ae["autoencoder"]
    # Share of the initial squared error on validation frames that training took away.
    fall = 1.0 - (1.0 - trained["r2_validation"]) / (1.0 - trained["r2_initial"])
    return {
        "parameters": parameter_counts(stages),
        "autoencoder": {
            "training": trained | {"error_fall": fall},
            "pca": train_ae["pca"],
            "comparisons": train_ae.get("comparisons", []),
        },
        "paper": compare(measure(stages, gender)),
    }


def _table_1(stages: Stages) -> list[dict[str, Any]]:
    """The paper's Table 1 of this run: what was aligned, and what was only predicted."""
    evaluate = stages["evaluate"]
    first = next(iter(evaluate.manifest["pipelines"].values()))
    aligned = sequences_of(stages[first["alignment"]])
    tested = [one for one in sequences_of(evaluate) if one.split == "test"]
    mosh_fps = mosh_rate(stages.get("corpus")).value
    made = evaluate.origin == "synthetic"
    return [
        {
            "dataset": f"in place of {name}" if made else name,
            "people": len({one.subject for one in sequences}),
            "motions": ", ".join(sorted({kind_of(one.motion) for one in sequences})),
            "fps": fps,
            "sequences": len(sequences),
        }
        for name, sequences, fps in (
            ("Dyna", aligned, aligned[0].fps),
            ("Mosh", tested, mosh_fps),
        )
        if sequences
    ]


def departures(stages: Stages) -> list[str]:
    """Where the run leaves the paper's words, in its stages' own."""
    found: list[str] = []
    if "train-ae" in stages:
        trained = stages["train-ae"].manifest["autoencoder"]
        found += [f"autoencoder: {text}" for text in trained.get("departures", ())]
    for stage in ("train", TRAIN_PLUS):
        if stage in stages:
            for name, one in stages[stage].manifest["predictors"].items():
                found += [f"`{name}`: {text}" for text in one["departures"]]
    return found


def read_parity(verify: Artifact) -> dict[str, Any]:
    return json.loads(verify.file("parity.json").read_text(encoding="utf-8"))


def verification(stages: Stages) -> dict[str, Any] | None:
    """Rows, those that hold, and the largest differences of each engine and precision."""
    if "verify" not in stages:
        return None
    parity = read_parity(stages["verify"])
    rows, engines = parity["rows"], parity["engines"]
    differentiated = {row["engine"] for row in rows if row["part"] == "gradients"}

    def largest(engine: str, dtype: str, forward: bool) -> float | None:
        own = (row for row in rows if (row["engine"], row["dtype"]) == (engine, dtype))
        found = [row["max_rel"] for row in own if (row["part"] in _FORWARD) == forward]
        return max((one for one in found if one is not None), default=None)

    return {
        "forward_only": [engine for engine in engines if engine not in differentiated],
        "rows": len(rows),
        "held": sum(row["passed"] for row in rows),
        "diagnosis": list(parity["diagnosis"]),
        "engines": [
            {
                "engine": engine,
                "version": engines[engine].get(_PACKAGES[engine], ""),
                "precision": dtype,
                "forward": largest(engine, dtype, True),
                "backward": largest(engine, dtype, False),
            }
            for engine, dtype in dict.fromkeys((row["engine"], row["dtype"]) for row in rows)
        ],
    }


def _stage(manifest: dict[str, Any]) -> dict[str, Any]:
    provenance = manifest["provenance"]
    apart = (*_OF_EVERY_STAGE, *_SHOWN_OF_STAGES)
    return {
        **{key: provenance[key] for key in _SHOWN_OF_STAGES},
        "seed": settings_of(manifest).get("seed"),
        "config": manifest["config"],
        "measured": {key: value for key, value in provenance.items() if key not in apart},
    }


def of_other_seeds(run: Run, evaluate: Artifact) -> dict[int, Artifact]:
    """`evaluate` of the runs `<run>-seed<N>` beside a run, by seed; who left the run's alignment is
    left out."""
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


def _of_seeds(stages: Stages, others: Mapping[int, Artifact]) -> dict[str, Any]:
    """Mean and spread of the trained predictors' errors over seeds."""
    evaluate, trained = stages["evaluate"], stages["train" if "train" in stages else TRAIN_PLUS]
    pipelines = evaluate.manifest["pipelines"].values()
    names = [name for pipeline in pipelines for name in pipeline["predictors"]]
    cells = (one.manifest["cells"] for one in (evaluate, *others.values()))
    seeds = [settings_of(trained.manifest)["seed"], *others]
    return {"seeds": seeds, "cells": spread_over(cells, names)}


def _took_s(evaluate: Artifact) -> float:
    """Seconds of the stages that train and judge the predictors of a run."""
    run = Run(evaluate.path.parent.name)
    made = [run.artifact(stage) for stage in _OF_EVERY_SEED if run.finished(stage)]
    return sum(one.manifest["provenance"]["wall_time_s"] for one in made)


def spread_over(
    cells: Iterable[Mapping[str, Any]], predictors: Iterable[str]
) -> dict[str, dict[str, dict[str, dict[str, dict[str, float]]]]]:
    """Mean and standard deviation (of a sample) over seeds of what each of these `cells`, by seed,
    measured: by test group, predictor, reference and number, as in each of them."""
    every = list(cells)
    spread: dict[str, Any] = {}
    for cell, name, (reference, number) in product(every[0], predictors, _SPREAD):
        found = [one.get(cell, {}).get(name, {}).get(reference, {}).get(number) for one in every]
        if None not in found:
            own = spread.setdefault(cell, {}).setdefault(name, {}).setdefault(reference, {})
            own[number] = {"mean": float(np.mean(found)), "sd": float(np.std(found, ddof=1))}
    return spread
