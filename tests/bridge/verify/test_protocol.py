"""Requests survive the disk, and an engine that stumbles says so and goes on."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from bridge.exchange import save_weights
from bridge.verify.engines import ENGINES, ask
from bridge.verify.protocol import Case, EngineConfig, read_request, write_request


def case(name: str, **changes) -> Case:
    given = {"op": "dsnet_forward", "dtype": "float64", "engines": ("numpy", "torch")}
    return Case(name, **{**given, **changes})


def test_a_request_survives_the_disk(tmp_path):
    cases = [case("a", options={"run": "whole", "steps": [1, 10]}), case("b", engines=("torch",))]
    write_request(tmp_path, cases)
    (read,) = read_request(EngineConfig(tmp_path, tmp_path / "out", "numpy"))
    assert (read.name, read.options, read.engines) == ("a", cases[0].options, cases[0].engines)
    both = read_request(EngineConfig(tmp_path, tmp_path / "out", "torch"))
    assert [one.scratch.name for one in both] == ["a", "b"]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_arrays_come_in_the_cases_precision_and_start_from_the_same_numbers(tmp_path, dtype):
    drawn = np.random.default_rng(0).normal(size=5).astype(np.float32)
    save_weights(tmp_path / "w.safetensors", {"w": drawn, "real": drawn > 0})
    write_request(tmp_path, [case("a", dtype=dtype, weights_file="w.safetensors")])
    (read,) = read_request(EngineConfig(tmp_path, tmp_path, "numpy"))
    arrays = read.weights()
    assert arrays["w"].dtype == dtype
    assert arrays["real"].dtype == bool
    np.testing.assert_array_equal(arrays["w"], drawn)
    assert read.inputs() == {}


def test_a_case_that_raises_is_an_answer_and_the_others_go_on(tmp_path):
    weights = {"offsets": np.zeros((1, 2), np.float32)}
    save_weights(tmp_path / "w.safetensors", weights)
    stream = {"op": "dsnet_stream", "weights_file": "w.safetensors", "inputs_file": "w.safetensors"}
    write_request(tmp_path, [case("bad", **stream), case("odd", op="no_such_operation")])
    answer = ask("numpy", tmp_path, tmp_path / "out")
    assert not answer.failure
    assert set(answer.errors) == {"bad", "odd"}
    assert "motion" in answer.why_missing("bad")
    assert "no_such_operation" in answer.why_missing("odd")
    assert "left this case out" in answer.why_missing("never asked")


def test_an_engine_that_dies_is_an_answer(tmp_path, monkeypatch):
    monkeypatch.setitem(ENGINES, "torch", "no_such_module")
    answer = ask("torch", tmp_path, tmp_path / "out")
    assert "no_such_module" in answer.why_missing("any")
    assert "\n" not in answer.failure


def test_the_reference_and_the_stream_load_no_framework():
    for module in ("bridge.verify.stage_verify", ENGINES["numpy"], ENGINES["stream"]):
        code = f"import sys, {module}; print({{'torch', 'tensorflow', 'keras'}} & set(sys.modules))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
        assert done.stdout.strip() == b"set()", module


def test_answers_name_tensors_in_the_order_of_computation(tmp_path):
    bodies = {"betas": (1, 10), "pose": (1, 24, 3), "trans": (1, 3)}
    bodies |= dict.fromkeys(("offsets", "mesh", "probe"), (1, 6890, 3))
    save_weights(
        tmp_path / "i.safetensors", {n: np.zeros(s, np.float32) for n, s in bodies.items()}
    )
    body = {"body": "embedded:female"}
    write_request(tmp_path, [case("s", op="smpl", inputs_file="i.safetensors", options=body)])
    answer = ask("numpy", tmp_path, tmp_path / "out")
    layers = [f"layer/{n}" for n in ("rotations", "joints", "rest_vertices", "vertices", "unposed")]
    assert answer.order["s"][:5] == layers
    assert json.loads((tmp_path / "out" / "engine.json").read_text())["versions"]["numpy"]
