"""What computes: ONNX Runtime, the framework that trained a network, or a layer of PyTorch."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.runs import Artifact
from bridge.tissue.trained_plus import TrainedPlus

Runtime = Literal["onnx", "keras"]
RUNTIME_NAMES: dict[Runtime, str] = {"onnx": "ONNX Runtime", "keras": "Keras"}
LatentsOf: TypeAlias = Callable[[NDArray, NDArray], NDArray[np.float32]]
"""Latents (T, 100) of a whole motion theta (T, 69) of a body betas (10,)."""


def keras_latents(train: Artifact, name: str, body: BodyModelData) -> LatentsOf:
    """A trained network as `dsnet infer` applies it: a Keras model of whole motions.

    MissingPackageError where Keras is not installed.
    """
    return import_module("tf_dsnet.predictors").load_predictor(train, name, lambda: body)


def torch_soft_tissue(trained: TrainedPlus, body: BodyModelData) -> Any:
    """`torch_align_ae.SoftTissue`; MissingPackageError where PyTorch is not installed."""
    return import_module("torch_align_ae.tissue").SoftTissue(trained, body)
