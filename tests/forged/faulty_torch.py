"""PyTorch's engine of `dsnet verify`, which makes the mistake that a case asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import wraps
from typing import Any

import pytest

from bridge.exchange.engine import Operation, Tensors, serve
from bridge.exchange.weights import KERAS_ADAM
from torch_align_ae import dsnet, verify


def _mistaken(operation: Operation) -> Operation:
    """The operation, which may be given `faults`: constants by name."""

    @wraps(operation)
    def apply(weights: Tensors, faults: Mapping[str, Any] | None = None, **given: Any) -> Tensors:
        constants = dict(faults or {})
        if constants.pop("forget_mask", False):
            given["masked"] = False
        with pytest.MonkeyPatch.context() as patch:
            if "adam_epsilon" in constants:
                rule = replace(KERAS_ADAM, epsilon=constants.pop("adam_epsilon"))
                patch.setattr(dsnet, "KERAS_ADAM", rule)
            for name, value in constants.items():
                patch.setattr(dsnet, name.upper(), value)
            return operation(weights, **given)

    return apply


if __name__ == "__main__":
    serve(*map(_mistaken, verify.OPERATIONS), packages=("torch",))
