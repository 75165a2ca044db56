"""From answers to rows: what is compared, what is left out, and what is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.exchange import load_weights, save_weights
from bridge.verify import draws
from bridge.verify.checks import Check, Plan
from bridge.verify.runner import verify

WEIGHTS = {"a/kernel": np.ones((2, 2), np.float32), "a/bias": np.zeros(2, np.float32)}
CLIP = Check("clip", "dsnet_forward", {"torch": ("float64",)}, "w", "i", {"run": "whole"})


@pytest.fixture(scope="module")
def plan() -> Plan:
    return Plan([CLIP], {"w": draws.dsnet_weights(0), "i": draws.motion(0, 1, 3)})


@pytest.mark.parametrize("left_out", [False, True])
def test_what_is_left_out_is_not_compared(plan, tmp_path, ask_reference, left_out):
    def ask(engine, request, out):
        answer = ask_reference(engine, request, out)
        if engine == "torch":
            path = out / "clip.float64.safetensors"
            arrays = load_weights(path)
            save_weights(path, {**arrays, "layer/lstm": arrays["layer/lstm"] + 1})
        return answer

    check = replace(CLIP, leave_out=("layer/lstm",) if left_out else ())
    (row,), _ = verify(replace(plan, checks=[check]), tmp_path, run_engine=ask)
    assert row.passed == left_out


@pytest.mark.parametrize("silent", ["torch", "numpy"])
def test_an_engine_without_a_result_is_a_row_that_fails(plan, tmp_path, ask_reference, silent):
    def ask(engine, request, out):
        answer = ask_reference(engine, request, out)
        if engine != silent:
            return answer
        return replace(answer, order={}, errors={"clip.float64": "ValueError: too tired"})

    (row,), _ = verify(plan, tmp_path, run_engine=ask)
    assert not row.passed
    assert (row.engine, row.problem) == (silent, "ValueError: too tired")


def test_a_format_that_is_not_returned_fails(tmp_path, ask_reference):
    def ask(engine, request, out):
        answer = ask_reference(engine, request, out)
        path = out / "files.float32.safetensors"
        kept = {n: a for n, a in load_weights(path).items() if "/state_dict/" not in n}
        save_weights(path, kept)
        return answer

    check = Check("files", "formats", {"torch": ("float32",)}, "w")
    (row,), _ = verify(Plan([check], {"w": WEIGHTS}), tmp_path, run_engine=ask)
    assert not row.passed
    assert row.first.startswith("weight/state_dict/")
