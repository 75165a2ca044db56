"""Functions of the frameworks' packages that stages call: named here, loaded when called.

`dsnet` imports neither package: a command whose work needs no framework loads none, and the two
frameworks never meet in one process.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

FUNCTIONS = {
    "load_predictor": "tf_dsnet.predictors",
    "registered_predictors": "tf_dsnet.predictors",
    "train_networks": "tf_dsnet.train_networks",
    "train_plus": "tf_dsnet.train_plus",
}


def of_framework(function: str) -> Callable[..., Any]:
    """One of `FUNCTIONS`; `MissingPackageError` where its framework is not installed."""
    return getattr(import_module(FUNCTIONS[function]), function)
