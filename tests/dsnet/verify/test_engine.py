"""Requests are read as they were written; a case that fails does not stop the engine."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from bridge.exchange.engine import answer, load_tensors
from dsnet.verify import engines
from dsnet.verify.compare import Skipped, skipped_rows
from dsnet.verify.engines import ENGINES, Check, run_engine, write_requests

DRAWN = np.random.default_rng(0).normal(size=5).astype(np.float32)
STREAM = Check("bad", "dsnet_stream", {}, inputs={"offsets": np.zeros((1, 2), np.float32)})


def test_who_is_asked_what():
    both = Check("a", "smpl", {"torch": ("float64", "float32"), "onnx": ("float32",)})
    graph = Check("g", "ae_decode", {"onnx": ("float32",)})
    asked = {e: [(c.name, d) for c in (both, graph) for d in c.precisions(e)] for e in ENGINES}
    assert asked == {
        "numpy": [("a", "float64"), ("g", "float64")],
        "torch": [("a", "float64"), ("a", "float32")],
        "keras": [],
        "torch-gpu": [],
        "keras-gpu": [],
        "onnx": [("a", "float32"), ("g", "float32")],
        "stream": [],
    }


@pytest.mark.parametrize("dtype", ["bfloat16", "float32", "float64"])
def test_arrays_come_in_the_cases_precision_and_start_from_the_same_numbers(tmp_path, dtype):
    options = {"run": "whole", "steps": (1, 10)}
    weights = {"w": DRAWN, "real": DRAWN > 0}
    check = Check("a", "op", {"torch": (dtype,)}, weights, options=options)
    write_requests(tmp_path / "request", {"torch": [check]})
    seen = []

    def op(weights, **options):
        seen.append((weights, options))
        return {"layer/second": np.zeros(()), "layer/first": weights["w"]}

    answer("torch", tmp_path / "request", tmp_path, {"op": op}, ["numpy"])
    ((arrays, given),) = seen
    told = {"bfloat16": True} if dtype == "bfloat16" else {}
    assert given == {"run": "whole", "steps": [1, 10], **told}
    assert arrays["w"].dtype == ("float64" if dtype == "float64" else "float32")
    assert arrays["real"].dtype == bool
    np.testing.assert_array_equal(arrays["w"], DRAWN)
    found = load_tensors(tmp_path / f"a.{dtype}.safetensors")
    assert list(found) == ["layer/second", "layer/first"], "in the order of computation"
    assert found["layer/second"].shape == (1,)


def test_a_case_that_raises_is_an_answer_and_the_others_go_on(tmp_path):
    odd, never = Check("odd", "no_such_operation", {}), Check("never asked", "smpl", {})
    write_requests(tmp_path / "request", {"numpy": [STREAM, odd]})
    result = run_engine("numpy", tmp_path / "request", tmp_path / "out")
    assert not result.failure
    assert set(result.errors) == {"bad.float64", "odd.float64"}
    assert "offsets" in result.why_missing(STREAM, "float64")
    assert "no_such_operation" in result.why_missing(odd, "float64")
    assert "left this case out" in result.why_missing(never, "float64")
    assert json.loads((tmp_path / "out" / "answer.json").read_text())["versions"]["numpy"]


def test_an_engine_that_dies_is_an_answer(tmp_path, monkeypatch):
    monkeypatch.setitem(ENGINES, "torch", "no_such_module")
    result = run_engine("torch", tmp_path, tmp_path / "out")
    assert "no_such_module" in result.why_missing(STREAM, "float64")
    assert "\n" not in result.failure


@pytest.mark.parametrize(("drivers", "why"), [((), "no GPU"), (("dev/null",), "finds no GPU")])
def test_an_engine_that_a_machine_cannot_have_is_no_failure(tmp_path, monkeypatch, drivers, why):
    monkeypatch.setattr(engines, "_GPU_DRIVERS", drivers)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    check = Check("a", "smpl", {"torch-gpu": ("float64",)})
    result = run_engine("torch-gpu", tmp_path, tmp_path / "out")
    assert result.missing.endswith(why)
    assert not result.failure
    (skipped,) = skipped_rows([check], {"torch-gpu": result})
    assert skipped == Skipped("a", "torch-gpu", "float64", result.missing)


def test_the_reference_and_what_is_deployed_load_no_framework():
    modules = ", ".join(["dsnet.verify.stage_verify", ENGINES["numpy"], ENGINES["stream"]])
    code = f"import sys, {modules}; print({{'torch', 'tensorflow', 'keras'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout.strip() == b"set()"
