"""An engine without a framework: the reference in this process, with planted faults."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.exchange.engine import Tensors, answer
from dsnet.verify.checks import random_checks
from dsnet.verify.engines import Check, EngineResult, RunEngine
from dsnet.verify.reference import dsnet
from dsnet.verify.reference.engine import OPERATIONS


@pytest.fixture(scope="session")
def checks() -> list[Check]:
    """All checks that need no run."""
    return random_checks(0, "embedded:female")


@pytest.fixture(scope="session")
def run_reference() -> RunEngine:
    """In place of `dsnet.verify.engines.run_engine`."""
    return _run


def _run(engine: str, request: Path, out: Path) -> EngineResult:
    """The reference in place of any engine's process; float32 is the float64 result, rounded."""
    out.mkdir(parents=True)
    operations = {op.__name__: partial(_rounded, op) for op in OPERATIONS}
    answer(engine, request, out, operations, ["numpy"])
    return EngineResult(out, **json.loads((out / "answer.json").read_text()))


def _rounded(
    operation: Callable[..., Tensors],
    *weights: Tensors,
    faults: Mapping[str, Any] | None = None,
    bfloat16: bool = False,
    **given: Any,
) -> Tensors:
    del bfloat16  # whose arrays are float32
    faults, wide = faults or {}, [_wide(arrays) for arrays in weights]
    single = any(a.dtype == np.float32 for a in [*_arrays(*weights), *_arrays(given)])
    if faults.get("forget_mask"):
        given["masked"] = False
    constants = {
        "BATCH_NORM_EPSILON": faults.get("batch_norm_epsilon"),
        "BATCH_NORM_MOMENTUM": faults.get("batch_norm_momentum"),
    }
    if "adam_epsilon" in faults:
        constants["KERAS_ADAM"] = replace(dsnet.KERAS_ADAM, epsilon=faults["adam_epsilon"])
    with pytest.MonkeyPatch.context() as patch:
        for name, value in constants.items():
            if value is not None:
                patch.setattr(dsnet, name, value)
        found = operation(*wide, **_wide(given))
    return {name: array.astype(np.float32 if single else float) for name, array in found.items()}


def _arrays(*sets: Mapping[str, Any]) -> list[np.ndarray]:
    return [array for arrays in sets for array in arrays.values() if hasattr(array, "dtype")]


def _wide(given: Mapping[str, Any]) -> dict[str, Any]:
    is_single = {name: getattr(array, "dtype", None) == np.float32 for name, array in given.items()}
    return {n: array.astype(float) if is_single[n] else array for n, array in given.items()}
