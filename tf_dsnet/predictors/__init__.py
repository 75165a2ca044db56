"""The registry of predictors: what everything in `tf_dsnet` asks, one file for each entry."""

from __future__ import annotations

from collections.abc import Iterable

from bridge.errors import DsnetError, did_you_mean
from bridge.exchange import load_weights
from bridge.exchange.trained_dsnet import COMPARED_PRESET, check_trained
from bridge.runs import Artifact
from tf_dsnet.predictors.base import (
    BodyOf,
    PredictMotion,
    Predictor,
    PredictorSettings,
    PredictorTraining,
    TrainingData,
)
from tf_dsnet.predictors.compared.casas_otaduy_like import CasasOtaduyLike
from tf_dsnet.predictors.compared.dsnet_variants import VARIANTS
from tf_dsnet.predictors.compared.dyna_like import DynaLike, dyna_like_dmpl
from tf_dsnet.predictors.compared.softsmpl_like import SoftSmplLike
from tf_dsnet.predictors.dsnet_differences import DifferencesDsnet
from tf_dsnet.predictors.dsnet_faithful import FaithfulDsnet
from tf_dsnet.predictors.dsnet_standardised import StandardisedDsnet

PREDICTORS: dict[str, Predictor] = {
    entry.name: entry
    for entry in (
        StandardisedDsnet(),
        FaithfulDsnet(),
        DifferencesDsnet(),
        *VARIANTS,
        DynaLike(),
        dyna_like_dmpl(),
        CasasOtaduyLike(),
        SoftSmplLike(),
    )
}
"""Every predictor by name."""
BOTH_PRESETS = ("dsnet_standardised", "dsnet_faithful")
"""Those that are trained unless others are named: the paper's network."""
COMPARED = tuple(name for name, entry in PREDICTORS.items() if entry.preset == COMPARED_PRESET)
"""Those that are there to be compared with, each given the same care."""


def predictors_named(names: Iterable[str]) -> list[Predictor]:
    """The entries of these names.

    Raises
    ------
    DsnetError
        If there is none, one is unknown, or one is named twice.
    """
    names = list(names)
    if not names or len(set(names)) < len(names) or not set(names) <= PREDICTORS.keys():
        unknown = next((name for name in names if name not in PREDICTORS), "")
        raise DsnetError(
            f"predictors {' '.join(names) or '(none)'}",
            f"some of {', '.join(PREDICTORS)}, each once",
            did_you_mean(unknown, PREDICTORS, f"Pass --predictors {' '.join(BOTH_PRESETS)}."),
        )
    return [PREDICTORS[name] for name in names]


def load_predictor(train: Artifact, name: str, body: BodyOf) -> PredictMotion:
    """One predictor that the run has trained, for motions of `body`.

    Raises
    ------
    DsnetError
        If the run has not trained it, or its weights are damaged.
    """
    check_trained(train, name)
    (entry,) = predictors_named([name])
    return entry.load(load_weights(train.file(f"{name}.safetensors")), body)


__all__ = [
    "BOTH_PRESETS",
    "COMPARED",
    "PREDICTORS",
    "BodyOf",
    "PredictMotion",
    "Predictor",
    "PredictorSettings",
    "PredictorTraining",
    "TrainingData",
    "load_predictor",
    "predictors_named",
]
