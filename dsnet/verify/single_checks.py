"""Checks of one operation each, by which engines and in which precisions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bridge.exchange.engine import NORMALISER, DTypeName, Tensors
from bridge.paper import LATENT_SIZE
from dsnet.verify.engines import Check

BOTH: tuple[DTypeName, ...] = ("float64", "float32")
DOUBLE, SINGLE = BOTH[:1], BOTH[1:]
FRAMEWORKS = {"torch": BOTH, "keras": BOTH}
IN_FLOAT64 = {"torch": DOUBLE, "keras": DOUBLE}
IN_BFLOAT16: dict[str, tuple[DTypeName, ...]] = {"torch": ("bfloat16",)}
ONNX, STREAM = {"onnx": SINGLE}, {"stream": SINGLE}
KERAS_FILES = "keras", "savedmodel", "tflite"
Options = Mapping[str, Any]


def dsnet_forward(name: str, weights: Tensors, inputs: Tensors, run: str = "whole") -> Check:
    return Check(name, "dsnet_forward", FRAMEWORKS, weights, inputs, {"run": run})


def dsnet_train(
    name: str, weights: Tensors, clips: Tensors, steps: tuple[int, ...], *, masked: bool = False
) -> Check:
    options = {"masked": masked, "steps": steps}
    return Check(name, "dsnet_train", FRAMEWORKS, weights, clips, options)


def ae_forward(name: str, weights: Tensors, values: Tensors, options: Options) -> Check:
    return Check(name, "ae_forward", FRAMEWORKS, weights, values, {"run": "whole", **options})


def ae_decode(name: str, weights: Tensors, options: dict[str, Any]) -> Check:
    latents = np.random.default_rng(0).normal(size=(3, LATENT_SIZE)).astype(np.float32)
    metric = {**weights, **normaliser(options["architecture"]["widths"][0])}
    return Check(name, "ae_decode", ONNX, metric, {"latents": latents}, options)


def normaliser(vertices: int) -> Tensors:
    return {n: np.full((vertices, 3), k * 1e-3, np.float32) for k, n in enumerate(NORMALISER, 1)}


def ae_train(
    name: str, weights: Tensors, values: Tensors, options: Options, steps: tuple[int, ...]
) -> Check:
    return Check(name, "ae_train", FRAMEWORKS, weights, values, {**options, "steps": steps})


def dsnet_files(key: str, weights: Tensors, motion: Tensors, saved: str = "") -> list[Check]:
    """A network's files for Keras, as `dsnet export` writes them, in all forms."""
    keras = {"keras": SINGLE}
    return [
        Check(
            f"{key}-{form}", "dsnet_exported", keras, weights, motion,
            {"form": form, "saved": saved},
        )
        for form in KERAS_FILES
    ]  # fmt: skip


def architecture(widths: tuple[int, ...]) -> dict[str, Any]:
    return {"architecture": {"widths": widths}}
