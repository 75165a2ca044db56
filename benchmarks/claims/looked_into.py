"""What a trained network is asked: its error by test group, with somebody else's betas and with a
shorter history, and what a linear probe finds in its layers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.claims.data import KNOWN, VALIDATION
from benchmarks.claims.references import ScoredMotion, r2
from benchmarks.systems.dsnet_variants import DsnetVariant
from bridge.exchange.dsnet import TrainedDsnet, join_inputs
from bridge.motion.splits import CELLS
from tf_dsnet.framework import keras
from tf_dsnet.predictors import PredictMotion, TrainingData

HISTORIES = (1, 2, 3, 5, 10, 20, 40, 80)
"""Frames that the LSTM sees, this one included."""
_RIDGE = 1e-2


def by_cell(predict: PredictMotion, tested: Sequence[ScoredMotion]) -> dict[str, float]:
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


def exchanged(
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
        moved, whole = np.sum(
            [
                one.reference.moved(predict(one.theta, one.betas), other)
                for (one, _), other in zip(pairs, swapped, strict=True)
            ],
            axis=0,
        )
        found[cell] = {
            "own": by_cell(predict, own)[cell],
            "other": _pooled(
                [one.reference.errors(p) for (one, _), p in zip(pairs, swapped, strict=True)],
                [one for one, _ in pairs],
            ),
            "difference": round(float(np.sqrt(moved / whole)), 4),
        }
    return found


def inside(
    variant: DsnetVariant,
    arrays: dict[str, NDArray],
    data: TrainingData,
    tested: Sequence[ScoredMotion],
) -> dict[str, Any]:
    """Error with a shorter history, and what a linear probe finds in each layer."""
    trained = TrainedDsnet.from_arrays(variant.name, arrays)
    model = variant.rebuilt(trained.weights, len(trained.scaling.input_mean))
    layers = [model.get_layer(name).output for name in ("fc_enc_2", "lstm")]
    traced = keras.Model(model.input, layers)

    def of_layers(joined: NDArray) -> list[NDArray]:
        inputs = trained.scaling.inputs(joined)
        return [inputs, *(np.asarray(layer)[0] for layer in traced(inputs[None]))]

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
            rate: probe(of_fitted, of_judged, order)
            for rate, order in (("velocity", 1), ("acceleration", 2))
        }
    return {"history_r2": _histories(model, trained, tested), "probe_r2": probes}


def _histories(
    model: keras.Model, trained: TrainedDsnet, tested: Sequence[ScoredMotion]
) -> dict[str, dict[str, float]]:
    """R2, by test group and frames seen, over frames that have the longest history."""
    first = max(HISTORIES) - 1
    found: dict[str, dict[str, float]] = {}
    for cell in (VALIDATION, KNOWN):
        own = [one for one in tested if one.cell == cell]
        found[cell] = {}
        for seen in HISTORIES:
            errors = []
            for one in own:
                inputs = trained.scaling.inputs(join_inputs(one.theta, one.betas))
                windows = np.lib.stride_tricks.sliding_window_view(inputs, seen, axis=0)
                last = np.asarray(model(windows.swapaxes(1, 2), training=False))[:, -1]
                codes = trained.scaling.restore(last[first - seen + 1 :])
                errors.append(one.reference.errors(codes, first).sum())
            squares = sum(one.reference.squares[first:].sum() for one in own)
            found[cell][str(seen)] = round(float(1 - sum(errors) / squares), 5)
    return found


def probe(fitted: Sequence[Any], judged: Sequence[Any], order: int) -> float:
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
