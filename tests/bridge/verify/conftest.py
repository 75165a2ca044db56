"""An engine without a framework: the reference in this process, with the faults it is given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.exchange import save_weights
from bridge.verify.engines import Answer, Ask
from bridge.verify.protocol import Case, EngineConfig, Tensors, read_request
from bridge.verify.reference import dsnet
from bridge.verify.reference.engine import OPERATIONS
from bridge.verify.runner import FILE_FORMATS


@pytest.fixture(scope="session")
def ask_reference() -> Ask:
    """In place of `bridge.verify.engines.ask`."""
    return _answer


def _answer(engine: str, request: Path, out: Path) -> Answer:
    """Answer for any engine in place of its process; float32 is the float64 result, rounded."""
    out.mkdir(parents=True)
    order = {}
    for case in read_request(EngineConfig(request, out, engine)):
        tensors = {n: np.atleast_1d(a) for n, a in _computed(case, engine).items()}
        rounded = {name: array.astype(case.dtype) for name, array in tensors.items()}
        save_weights(out / f"{case.name}.safetensors", rounded)
        order[case.name] = list(tensors)
    return Answer(out, {"numpy": np.__version__}, {}, {}, order)


def _computed(case: Case, engine: str) -> Tensors:
    if case.op == "formats":
        return {
            f"weight/{name}/{key}": array
            for name in FILE_FORMATS[engine]
            for key, array in case.weights().items()
        }
    faults = case.options.get("faults", {})
    options = dict(case.options)
    if "adam_epsilon" in faults:
        options["adam"] = {**options.get("adam", {}), "epsilon": faults["adam_epsilon"]}
    if faults.get("forget_mask"):
        options["masked"] = False
    constants = {
        "BATCH_NORM_EPSILON": faults.get("batch_norm_epsilon"),
        "BATCH_NORM_MOMENTUM": faults.get("batch_norm_momentum"),
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in constants.items():
            if value is not None:
                patch.setattr(dsnet, name, value)
        exact = replace(case, dtype="float64", options=options)
        return dict(OPERATIONS[case.op](exact))
