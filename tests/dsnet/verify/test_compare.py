"""What counts as a difference, where it is, in which row it stands, and what is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.exchange.engine import DTypeName, load_tensors, save_tensors
from dsnet.verify import draws
from dsnet.verify.compare import compare, part_of, verify
from dsnet.verify.engines import Check

Arrays = dict[str, np.ndarray]
CLIP = Check(
    "clip",
    "dsnet_forward",
    {"torch": ("float64",)},
    draws.dsnet_weights(0),
    draws.motion(0, 1, 3),
    {"run": "whole"},
)


def rows_of(expected: Arrays, found: Arrays, dtype: DTypeName = "float64"):
    return list(compare(Check("check", "op", {}), "torch", dtype, expected, found))


@pytest.mark.parametrize(
    ("tensor", "part"),
    [
        ("layer/lstm", "layers"),
        ("loss", "loss"),
        ("losses", "losses"),
        ("grad/lstm/kernel", "gradients"),
        ("step_1/adam_m/lstm/kernel", "moments after 1"),
        ("step_10/adam_v/lstm/kernel", "moments after 10"),
        ("step_10/weight/lstm/kernel", "weights after 10"),
        ("stock descent/pose", "stock descent"),
        ("step_1/weight/batch_norm/moving_mean", "statistics after 1"),
    ],
)
def test_parts(tensor, part):
    assert part_of(tensor) == part


def test_the_worst_is_relative_to_its_own_scale_and_the_first_is_named():
    expected = {"layer/a": np.ones(3), "layer/b": np.full((2, 2), 1e-3), "layer/c": np.ones(1)}
    found = {name: array.copy() for name, array in expected.items()}
    found["layer/b"][1, 0] += 1e-6
    found["layer/c"][0] += 1e-5
    (row,) = rows_of(expected, found)
    assert not row.passed
    assert (row.tensor, row.index, row.first) == ("layer/b", (1, 0), "layer/b")
    np.testing.assert_allclose([row.max_abs, row.max_rel], [1e-5, 1e-3], rtol=1e-6)


ONES, NAN = np.ones(3), np.array([1.0, np.nan, 1.0])


@pytest.mark.parametrize(
    ("expected", "found"),
    [
        (ONES, {}),
        (ONES, {"layer/a": np.ones(4)}),
        (ONES, {"layer/a": np.ones(3, np.float32)}),
        (ONES, {"layer/a": np.array([1.0, np.inf, 1.0])}),
        (ONES, {"layer/a": NAN}),
        (NAN, {"layer/a": NAN}),
    ],
)
def test_no_tensor_another_shape_type_or_no_number_is_as_far_as_can_be(expected, found):
    (row,) = rows_of({"layer/a": expected}, found)
    assert not row.passed
    assert row.max_rel == np.inf


def test_zeros_must_be_zeros():
    zeros, tiny = {"grad/a": np.zeros(2)}, {"grad/a": np.array([0.0, 1e-300])}
    assert rows_of(zeros, zeros)[0].passed
    assert not rows_of(zeros, tiny)[0].passed


@pytest.mark.parametrize("left_out", [False, True])
def test_what_is_left_out_is_not_compared(tmp_path, run_reference, left_out):
    def ask(engine, request, out):
        answer = run_reference(engine, request, out)
        if engine == "torch":
            path = out / "clip.float64.safetensors"
            arrays = load_tensors(path)
            save_tensors(path, {**arrays, "layer/lstm": arrays["layer/lstm"] + 1})
        return answer

    check = replace(CLIP, leave_out=("layer/lstm",) if left_out else ())
    (row,), _ = verify([check], tmp_path / "work", run=ask)
    assert row.passed == left_out


@pytest.mark.parametrize("silent", ["torch", "numpy"])
def test_an_engine_without_a_result_is_a_row_that_fails(tmp_path, run_reference, silent):
    def ask(engine, request, out):
        answer = run_reference(engine, request, out)
        if engine != silent:
            return answer
        (out / "clip.float64.safetensors").unlink()
        return replace(answer, errors={"clip.float64": "ValueError: too tired"})

    (row,), _ = verify([CLIP], tmp_path / "work", run=ask)
    assert not row.passed
    assert (row.engine, row.problem) == (silent, "ValueError: too tired")
