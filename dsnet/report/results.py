"""Collect the numbers of a run's manifests for the report, as `results.json`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

from bridge.errors import notify
from bridge.exchange.dsnet import AUTOENCODER, LITERAL_CODES
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

_FROM_EVALUATE = ("predictors", "default", "pipelines", "test_bed", "cells", "alignments")
_FORWARD_PARTS = ("layers", "loss", "losses")
_PACKAGES = {
    "torch": "torch",
    "torch-gpu": "torch",
    "keras": "keras",
    "keras-gpu": "keras",
    "onnx": "onnxruntime",
    "stream": "numpy",
}
_NOT_SHOWN = ("command", "finished_utc", "sha256", "stamps", "input_stamps")
"""Keys of every stage's provenance that the report leaves out."""
_SHARED = ("truth", ALIGNMENT, ROBUST_ALIGNMENT)
"""Stages that runs of several seeds have in common."""
_PER_SEED = ("train", "infer", "decode", TRAIN_PLUS, INFER_PLUS, "evaluate")
"""Stages that each seed runs again."""
_SCORES = (("offsets", "r2"), ("mesh", "r2"), ("mesh", "mean_mm"))
"""Measures and scores whose mean and spread over seeds are reported."""
_PROVENANCE = ("wall_time_s", "peak_memory_mb", "machine", "versions")


def summarise(
    stages: Stages, run_name: str, gender: str, others: Mapping[int, Artifact]
) -> dict[str, Any]:
    """The contents of `results.json`; lengths are millimetres where the key says so.

    Entries of the paper's pipeline are None in a run without it. `gender` is that of the run's body
    model; `others` are the `evaluate` artifacts of trainings from other seeds, by seed.
    """
    evaluate = stages["evaluate"].manifest
    validation = validation_result(stages["evaluate"])
    held_out = "" if validation is None else f", `{validation['name']}`"
    titles = {"validation": f"held out{held_out}"} | CELLS
    titles |= {"test": "all of the four test groups", "train": "trained on (first of each person)"}
    summary = {
        "run": run_name,
        "data": stages["evaluate"].origin,
        **{key: evaluate[key] for key in _FROM_EVALUATE},
        "seeds": _of_seeds(stages, others) if others else None,
        "table_1": _table_1(stages),
        "cell_titles": {key: text for key, text in titles.items() if key in evaluate["cells"]},
        "sequences": evaluate["per_sequence"],
        **_paper_pipeline(stages, gender),
        "verification": verification(stages),
        "stages": {name: _stage(artifact.manifest) for name, artifact in stages.items()},
        "seeds_took_s": {str(seed): _took_s(other) for seed, other in others.items()},
    }
    # JSON has no NaN or infinity: both become null.
    return json.loads(json.dumps(summary), parse_constant=lambda _: None)


def _paper_pipeline(stages: Stages, gender: str) -> dict[str, Any]:
    """The networks of the paper's pipeline, and the paper's numbers compared with ours."""
    if "decode" not in stages:
        return dict.fromkeys(("parameters", "autoencoder", "paper"))
    train_ae = stages["train-ae"].manifest
    trained = train_ae["autoencoder"]
    # The fraction of the initial squared error on validation frames that training removed.
    fall = 1.0 - (1.0 - trained["r2_validation"]) / (1.0 - trained["r2_initial"])
    return {
        "parameters": parameter_counts(stages),
        "autoencoder": {
            "training": trained | {"error_fall": fall},
            "pca": train_ae["pca"],
            "comparisons": [
                *(train_ae[code] for code in LITERAL_CODES if code in train_ae),
                *train_ae.get("comparisons", []),
            ],
        },
        "paper": compare(measure(stages, gender)),
    }


def _table_1(stages: Stages) -> list[dict[str, Any]]:
    """The paper's Table 1 for this run: the aligned sequences and the test sequences."""
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
    """Where the run departs from the paper, as its training stages recorded it."""
    texts: list[str] = []
    aligned = stages[ALIGNMENT].manifest["config"] if ALIGNMENT in stages else {}
    if (aligner := aligned.get("aligner", "sgd")) != "sgd":
        texts.append(f"alignment: by `{aligner}`, which is this repository's, in place of SGD")
    if aligned.get("iterate") == "last":
        texts.append("alignment: a frame's last iterate in place of the best matching one")
    if aligned.get("betas_per") == "sequence":
        texts.append("alignment: each sequence has its own shape, of its first frame")
    if "train-ae" in stages:
        train_ae = stages["train-ae"].manifest
        for code in (AUTOENCODER, *LITERAL_CODES):
            texts += [f"`{code}`: {text}" for text in train_ae.get(code, {}).get("departures", ())]
    for stage in ("train", TRAIN_PLUS):
        if stage in stages:
            for name, one in stages[stage].manifest["predictors"].items():
                texts += [f"`{name}`: {text}" for text in one["departures"]]
    settings = stages["train"].manifest["config"].get("predictors") if "train" in stages else None
    if isinstance(settings, Mapping):
        epochs = {name: one["epochs"] for name, one in settings.items()}
        if len({*epochs.values()}) > 1:  # a comparison of unequal trainings
            texts += [f"`{name}`: trained for {count} epochs" for name, count in epochs.items()]
    return texts


def read_parity(verify: Artifact) -> dict[str, Any]:
    """The contents of `parity.json`, see `dsnet.verify.stage_verify.parity`."""
    return json.loads(verify.file("parity.json").read_text(encoding="utf-8"))


def verification(stages: Stages) -> dict[str, Any] | None:
    """Number of rows of `dsnet verify`, how many passed, and the largest differences by engine."""
    if "verify" not in stages:
        return None
    parity = read_parity(stages["verify"])
    rows, engines = parity["rows"], parity["engines"]
    differentiated = {row["engine"] for row in rows if row["part"] == "gradients"}

    def largest(engine: str, dtype: str, forward: bool) -> float | None:
        differences = [
            row["max_rel"]
            for row in rows
            if (row["engine"], row["dtype"]) == (engine, dtype)
            and (row["part"] in _FORWARD_PARTS) == forward
        ]
        return max((one for one in differences if one is not None), default=None)

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
    apart = (*_NOT_SHOWN, *_PROVENANCE)
    return {
        **{key: provenance[key] for key in _PROVENANCE},
        "seed": settings_of(manifest).get("seed"),
        "config": manifest["config"],
        "measured": {key: value for key, value in provenance.items() if key not in apart},
    }


def of_other_seeds(run: Run, evaluate: Artifact) -> dict[int, Artifact]:
    """The `evaluate` artifacts of the runs `<run>-seed<N>`, by seed.

    A run with another truth or alignment than `run` is left out, with a note.
    """
    artifacts: dict[int, Artifact] = {}
    for path in run.path.parent.iterdir():
        named = re.fullmatch(re.escape(run.name) + r"-seed([0-9]+)", path.name)
        if named and Run(path.name).finished("evaluate"):
            other = read_artifact(path / "evaluate")
            upstreams = [one.manifest["upstream"] for one in (evaluate, other)]
            expected, shared = ([upstream.get(name) for name in _SHARED] for upstream in upstreams)
            if shared == expected:
                artifacts[int(named[1])] = other
            else:
                notify(
                    f"left out: run {path.name!r}, which is of another alignment than {run.name!r}"
                )
    return dict(sorted(artifacts.items()))


def _of_seeds(stages: Stages, others: Mapping[int, Artifact]) -> dict[str, Any]:
    """Mean and spread of the trained predictors' errors over seeds."""
    evaluate, trained = stages["evaluate"], stages["train" if "train" in stages else TRAIN_PLUS]
    pipelines = evaluate.manifest["pipelines"].values()
    names = [name for pipeline in pipelines for name in pipeline["predictors"]]
    cells = (one.manifest["cells"] for one in (evaluate, *others.values()))
    seeds = [settings_of(trained.manifest)["seed"], *others]
    return {"seeds": seeds, "cells": spread_over(cells, names)}


def _took_s(evaluate: Artifact) -> float:
    """Seconds of the stages that train and evaluate the predictors of a run."""
    run = Run(evaluate.path.parent.name)
    made = [run.artifact(stage) for stage in _PER_SEED if run.finished(stage)]
    return sum(one.manifest["provenance"]["wall_time_s"] for one in made)


def spread_over(
    cells: Iterable[Mapping[str, Any]], predictors: Iterable[str]
) -> dict[str, dict[str, dict[str, dict[str, dict[str, float]]]]]:
    """Mean and sample standard deviation over seeds of the predictors' scores.

    Parameters
    ----------
    cells : errors of each seed by test group, predictor, quantity and score, as in `evaluate`.

    Returns
    -------
    The same nesting, with `{"mean": ..., "sd": ...}` in place of each score that all seeds have.
    """
    seeds = list(cells)
    spread: dict[str, Any] = {}
    for group, name, (quantity, score) in product(seeds[0], predictors, _SCORES):
        values = [one.get(group, {}).get(name, {}).get(quantity, {}).get(score) for one in seeds]
        if None not in values:
            scores = spread.setdefault(group, {}).setdefault(name, {}).setdefault(quantity, {})
            scores[score] = {"mean": float(np.mean(values)), "sd": float(np.std(values, ddof=1))}
    return spread
