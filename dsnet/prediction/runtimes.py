"""What computes a network's latents: ONNX Runtime, or the framework that trained it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.runs import Artifact

Runtime = Literal["onnx", "keras"]
RUNTIME_NAMES: dict[Runtime, str] = {"onnx": "ONNX Runtime", "keras": "Keras"}
LatentsOf: TypeAlias = Callable[[NDArray, NDArray], NDArray[np.float32]]
"""Latents (T, 100) of a whole motion theta (T, 69) of a body betas (10,)."""


def keras_latents(train: Artifact, name: str, body: BodyModelData) -> LatentsOf:
    """A trained network as `dsnet infer` applies it: a Keras model of whole motions.

    MissingPackageError where Keras is not installed.
    """
    return import_module("tf_dsnet.predictors").load_predictor(train, name, lambda: body)
