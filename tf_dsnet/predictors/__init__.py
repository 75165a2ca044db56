"""The registry of predictors: what everything in `tf_dsnet` asks.

A new predictor is a file with a class as `Predictor` says, and a line: here, or in the function
`predictors()` of a module that `DSNET_PLUGINS` names (`bridge/plugins.py`).
"""

from __future__ import annotations

from collections.abc import Iterable

from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.dsnet import DSNETS, check_trained
from bridge.plugins import entry_named, with_plugins
from bridge.runs import Artifact
from tf_dsnet.predictors.base import (
    BodyOf,
    PredictMotion,
    Predictor,
    PredictorSettings,
    PredictorTraining,
    TrainingData,
)
from tf_dsnet.predictors.dsnet import FaithfulDsnet, StandardisedDsnet


def registered_predictors() -> dict[str, Predictor]:
    """Every predictor by name: the paper's network, and what plugins add."""
    own: tuple[Predictor, ...] = (StandardisedDsnet(), FaithfulDsnet())
    return with_plugins("predictors", {entry.name: entry for entry in own})


def predictors_named(names: Iterable[str]) -> list[Predictor]:
    """The entries of these names.

    Raises
    ------
    DsnetError
        If there is none, one is unknown, or one is named twice.
    """
    names, known = list(names), registered_predictors()
    if not names or len(set(names)) < len(names):
        raise DsnetError(
            f"--predictors {' '.join(names) or '(none)'}",
            f"some of {', '.join(known)}, each once",
            f"Pass --predictors {' '.join(DSNETS)}.",
        )
    return [entry_named(name, "predictor", known) for name in names]


def load_predictor(train: Artifact, name: str, body: BodyOf) -> PredictMotion:
    """One predictor that the run has trained, for motions of `body`.

    Raises
    ------
    DsnetError
        If the run has not trained it, nobody registers it, or its weights are damaged.
    """
    check_trained(train, name)
    (entry,) = predictors_named([name])
    return entry.load(load_weights(train.file(f"{name}.safetensors")), body)


__all__ = [
    "BodyOf",
    "PredictMotion",
    "Predictor",
    "PredictorSettings",
    "PredictorTraining",
    "TrainingData",
    "load_predictor",
    "predictors_named",
    "registered_predictors",
]
