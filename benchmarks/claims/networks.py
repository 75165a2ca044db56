"""`python -m benchmarks.claims.networks --out DIR`: DSNet and its rivals on what a run aligned.

For every seed: each system's error in every test group, how fast it converged, what it loses with
somebody else's betas or a shorter history, and what its layers hold of the joints' rates.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.claims.data import (
    MOTIONS,
    VALIDATION,
    ScoredMotion,
    StudyData,
    r2,
    root_mean_square_mm,
)
from benchmarks.plugin import predictors
from benchmarks.prediction.corpora import check_names
from benchmarks.processes import run_as_process
from benchmarks.systems.dsnet_variants import DsnetVariant
from bridge.body import load_body_model
from bridge.exchange.dsnet import TrainedDsnet, join_inputs
from bridge.exchange.train_options import PredictorSettings
from bridge.motion.splits import CELLS
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.run import body_model_path
from tf_dsnet.framework import keras
from tf_dsnet.predictors import PredictMotion, TrainingData

DSNET = "dsnet_pca"
"""The paper's network, the one whose history and layers are looked into."""
SYSTEMS = (
    DSNET, "dsnet_no_batch_norm", "dsnet_two_frames", "dsnet_rbf", "dsnet_no_betas",
    "dsnet_two_lstm", "dsnet_three_lstm", "dyna_like", "casas_otaduy_like", "softsmpl_like",
)  # fmt: skip
HISTORIES = (1, 2, 3, 5, 10, 20, 40, 80)
"""Frames that the LSTM sees, this one included."""
KNOWN = "known_person_known_motion"
_COMPONENTS = (8, 25, 100)
_RIDGE = 1e-2
_VALIDATE_EVERY = 10


@dataclass(frozen=True)
class NetworksConfig:
    """Train and score on an alignment of a run; a file's systems of the same data are kept."""

    out: Path
    """Folder that receives <alignment>-<seed>.json."""
    run: str = "demo"
    """Run of both pipelines, evaluated."""
    alignment: str = "align_robust"
    """Whose offsets are learned: align (the paper's) or align_robust."""
    seeds: tuple[int, ...] = (0,)
    """Training seeds."""
    systems: tuple[str, ...] = SYSTEMS
    """Which to train; dsnet_pca always."""
    epochs: int = 500
    """Of each, its search for a rate included."""


def main(config: NetworksConfig) -> None:
    """Write what is missing."""
    check_names((config.alignment,), tuple(MOTIONS), "alignments")
    check_names(config.systems, tuple(predictors()), "systems")
    run = Run(config.run)
    data = StudyData(run, config.alignment)
    body = load_body_model(str(body_model_path(run)))
    training = TrainingData(data.clips("train"), data.clips(VALIDATION), lambda: body)
    tested = data.tested()
    config.out.mkdir(parents=True, exist_ok=True)
    for seed in config.seeds:
        path = config.out / f"{config.alignment}-{seed}.json"
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        now_mm = root_mean_square_mm(tested, KNOWN)
        if kept.get("true_mm", now_mm) != now_mm:
            kept = {}
        found = _study(config, training, tested, seed, kept)
        write_text_atomically(path, json.dumps(found, indent=1, allow_nan=False) + "\n")


def _study(
    config: NetworksConfig,
    data: TrainingData,
    tested: Sequence[ScoredMotion],
    seed: int,
    kept: dict[str, Any],
) -> dict[str, Any]:
    settings = PredictorSettings(epochs=config.epochs, seed=seed)
    systems: dict[str, Any] = dict(kept.get("systems", {}))
    looked_into: dict[str, Any] = {}
    for name in dict.fromkeys((DSNET, *config.systems)):
        if name in systems:
            continue
        print(f"{name}, seed {seed}", flush=True)
        described, arrays = _trained(name, settings, data)
        predict = predictors()[name].load(arrays, data.body)
        systems[name] = described | {"r2": _by_cell(predict, tested)}
        if name == DSNET:
            variant = predictors()[DSNET]
            assert isinstance(variant, DsnetVariant)
            looked_into = {
                "exchanged_betas": _exchanged(predict, tested),
                **_inside(variant, arrays, data, tested),
            }
    return kept | {
        "command": " ".join(["python", "-m", "benchmarks.claims.networks", *sys.argv[1:]]),
        "run": config.run,
        "alignment": config.alignment,
        "seed": seed,
        "epochs": config.epochs,
        "true_mm": root_mean_square_mm(tested, KNOWN),
        "components_r2": _components(tested),
        "systems": systems,
        **looked_into,
    }


def _trained(
    name: str, settings: PredictorSettings, data: TrainingData
) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """What is told of a training, and its weights."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        training = predictors()[name].training(settings, data, Path(folder) / "checkpoint")
        for epoch in range(settings.epochs):
            last = epoch + 1 == settings.epochs
            training.epoch(epoch, validate=last or (epoch + 1) % _VALIDATE_EVERY == 0)
        described = {
            "label": predictors()[name].label,
            "parameters": next(iter(training.parameters().values())),
            "rate": training.lr,
            "train_s": round(time.perf_counter() - started, 1),
            "loss": [round(float(loss), 3) for loss in training.losses],
            "validation_loss": [round(float(loss), 3) for loss in training.validation_losses],
        }
        return described, training.arrays()


def _by_cell(predict: PredictMotion, tested: Sequence[ScoredMotion]) -> dict[str, float]:
    """R2 of the offsets in each test group."""
    found = {}
    for cell in (VALIDATION, *CELLS):
        own = [one for one in tested if one.cell == cell]
        if own:
            errors = [one.reference.errors(predict(one.theta, one.betas)) for one in own]
            found[cell] = _pooled(errors, own)
    return found


def _pooled(errors: Sequence[NDArray], tested: Sequence[ScoredMotion]) -> float:
    squares = [one.reference.squares for one in tested]
    return round(r2(np.concatenate(errors), np.concatenate(squares)), 5)


def _exchanged(
    predict: PredictMotion, tested: Sequence[ScoredMotion]
) -> dict[str, dict[str, float]]:
    """R2 with everybody's own betas, and with those of each other person that was trained on."""
    known = {one.name.split("_")[0]: one.betas for one in tested if "new" not in one.cell}
    found = {}
    for cell in (VALIDATION, KNOWN, "new_person_known_motion"):
        own = [one for one in tested if one.cell == cell]
        pairs = [
            (one, betas)
            for one in own
            for person, betas in known.items()
            if person != one.name.split("_")[0]
        ]
        swapped = [predict(one.theta, betas) for one, betas in pairs]
        straight = [predict(one.theta, one.betas) for one, _ in pairs]
        moved = sum(np.square(a - b).sum() for a, b in zip(straight, swapped, strict=True))
        whole = sum(np.square(a).sum() for a in straight)
        found[cell] = {
            "own": _by_cell(predict, own)[cell],
            "other": _pooled(
                [one.reference.errors(p) for (one, _), p in zip(pairs, swapped, strict=True)],
                [one for one, _ in pairs],
            ),
            "difference": round(float(np.sqrt(moved / whole)), 4),
        }
    return found


def _inside(
    variant: DsnetVariant,
    arrays: dict[str, NDArray],
    data: TrainingData,
    tested: Sequence[ScoredMotion],
) -> dict[str, Any]:
    """Error with a shorter history, and what a linear probe finds in each layer."""
    trained = TrainedDsnet.from_arrays(variant.name, arrays)
    model = variant.rebuilt(trained.weights, len(trained.scaling.input_mean))
    layers = [model.get_layer(name).output for name in ("fc_enc_2", "lstm")]
    inside = keras.Model(model.input, layers)

    def of_layers(joined: NDArray) -> list[NDArray]:
        inputs = trained.scaling.inputs(joined)
        return [inputs, *(np.asarray(layer)[0] for layer in inside(inputs[None]))]

    fitted = [(of_layers(clip.inputs), clip.inputs[:, -69:]) for clip in data.train]
    judged = [
        (of_layers(join_inputs(one.theta, one.betas)), one.theta)
        for one in tested
        if one.cell == KNOWN
    ]
    probes: dict[str, dict[str, float]] = {}
    for place, layer in enumerate(("input", "fc_enc_2", "lstm")):
        of_fitted = [(hidden[place], theta) for hidden, theta in fitted]
        of_judged = [(hidden[place], theta) for hidden, theta in judged]
        probes[layer] = {
            rate: _probe(of_fitted, of_judged, order)
            for rate, order in (("velocity", 1), ("acceleration", 2))
        }
    return {"history_r2": _histories(model, trained, tested), "probe_r2": probes}


def _histories(
    model: keras.Model, trained: TrainedDsnet, tested: Sequence[ScoredMotion]
) -> dict[str, dict[str, float]]:
    """R2, by test group and frames seen, over frames that have the longest history."""
    first = max(HISTORIES) - 1
    found: dict[str, dict[str, float]] = {}
    for cell in (KNOWN, "known_person_unseen_motion"):
        own = [one for one in tested if one.cell == cell]
        found[cell] = {}
        for seen in HISTORIES:
            errors = []
            for one in own:
                inputs = trained.scaling.inputs(join_inputs(one.theta, one.betas))
                windows = np.lib.stride_tricks.sliding_window_view(inputs, seen, axis=0)
                last = np.asarray(model(windows.swapaxes(1, 2), training=False))[:, -1]
                codes = trained.scaling.restore(last[first - seen + 1 :])
                padded = np.concatenate([one.reference.codes[:first], codes])
                errors.append(one.reference.errors(padded)[first:].sum())
            squares = sum(one.reference.squares[first:].sum() for one in own)
            found[cell][str(seen)] = round(float(1 - sum(errors) / squares), 5)
    return found


def _probe(fitted: Sequence[Any], judged: Sequence[Any], order: int) -> float:
    """R2 on unseen motions of a ridge regression from a layer to the pose's differences."""

    def table(pairs: Sequence[Any]) -> tuple[NDArray, NDArray]:
        features = np.concatenate([layer[order:] for layer, _ in pairs])
        rates = np.concatenate([np.diff(theta, order, axis=0) for _, theta in pairs])
        return features.astype(np.float64), rates.astype(np.float64)

    features, rates = table(fitted)
    mean, std = features.mean(axis=0), features.std(axis=0) + 1e-6
    scale, centre = rates.std(axis=0), rates.mean(axis=0)
    moving = scale > 1e-3 * scale.max()
    scaled = (features - mean) / std
    square = scaled.T @ scaled + _RIDGE * len(scaled) * np.eye(scaled.shape[1])
    weights = np.linalg.solve(square, scaled.T @ ((rates - centre) / np.where(moving, scale, 1)))
    features, rates = table(judged)
    wanted = ((rates - centre) / np.where(moving, scale, 1))[:, moving]
    error = np.square((features - mean) / std @ weights[:, moving] - wanted).sum()
    return round(float(1 - error / np.square(wanted).sum()), 5)


def _components(tested: Sequence[ScoredMotion]) -> dict[str, float]:
    """R2 of the held-out clip's offsets in the leading components."""
    own = [one.reference for one in tested if one.cell == VALIDATION]
    return {
        str(size): round(
            r2(
                np.concatenate(
                    [one.left_out + np.square(one.codes[:, size:]).sum(axis=1) for one in own]
                ),
                np.concatenate([one.squares for one in own]),
            ),
            5,
        )
        for size in _COMPONENTS
    }


if __name__ == "__main__":
    run_as_process(NetworksConfig, main)
