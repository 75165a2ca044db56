"""The registry of predictors: what everything in `tf_dsnet` asks, one file for each entry."""

from __future__ import annotations

from collections.abc import Iterable

from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.runs import Artifact
from tf_dsnet.predictors.base import (
    PredictMotion,
    Predictor,
    PredictorSettings,
    PredictorTraining,
    TrainingData,
)
from tf_dsnet.predictors.dsnet_faithful import FaithfulDsnet
from tf_dsnet.predictors.dsnet_standardised import StandardisedDsnet

PREDICTORS: dict[str, Predictor] = {
    entry.name: entry for entry in (StandardisedDsnet(), FaithfulDsnet())
}
"""Every predictor by name, the best first."""


def predictors_named(names: Iterable[str]) -> list[Predictor]:
    """The entries of these names.

    Raises
    ------
    DsnetError
        If there is none, one is unknown, or one is named twice.
    """
    names = list(names)
    if not names or len(set(names)) < len(names) or not set(names) <= PREDICTORS.keys():
        raise DsnetError(
            f"predictors {' '.join(names) or '(none)'}",
            f"some of {', '.join(PREDICTORS)}, each once",
            f"Pass --predictors {' '.join(PREDICTORS)}.",
        )
    return [PREDICTORS[name] for name in names]


def load_predictor(train: Artifact, name: str) -> PredictMotion:
    """One predictor that the run has trained.

    Raises
    ------
    DsnetError
        If the run has not trained it, or its weights are damaged.
    """
    if name not in train.manifest["predictors"]:
        raise DsnetError(
            f"predictor {name!r} asked of {train.path}",
            f"one of {', '.join(train.manifest['predictors'])}",
            f"Train it too: dsnet train --predictors {' '.join(PREDICTORS)}.",
        )
    (entry,) = predictors_named([name])
    return entry.load(load_weights(train.file(f"{name}.safetensors")))


__all__ = [
    "PREDICTORS",
    "PredictMotion",
    "Predictor",
    "PredictorSettings",
    "PredictorTraining",
    "TrainingData",
    "load_predictor",
    "predictors_named",
]
