"""Graphs of values: kernels in fewer bits, and files that dsnet did not write."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from onnx import ModelProto, TensorProto, helper, numpy_helper

from bridge import DsnetError
from bridge.runtime import onnx_graph
from bridge.runtime.onnx_graph import PRECISIONS, Graph, held_arrays, product

RNG = np.random.default_rng(0)
KERNEL = RNG.normal(size=(300, 400)).astype(np.float32)
FEATURES = RNG.normal(size=(3, 9, 300)).astype(np.float32)


@pytest.fixture(autouse=True)
def everything_is_large(monkeypatch):
    monkeypatch.setattr(onnx_graph, "_LARGE", 0)


def multiplied(precision, features: np.ndarray) -> np.ndarray:
    graph = Graph()
    found = product(graph, "kernel", KERNEL, precision)(graph.input("x", ("B", 9, 300)))
    model = graph.model("product", {"y": found}, {"y": ("B", 9, 400)})
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    return np.asarray(session.run(None, {"x": features})[0])


@pytest.mark.parametrize(
    ("precision", "share"), [("float32", 1e-6), ("float16", 1e-3), ("int8", 2e-2)]
)
def test_products_are_near_the_exact_one(precision, share):
    error = multiplied(precision, FEATURES) - FEATURES @ KERNEL
    assert np.sqrt(np.mean(error**2)) < share * np.sqrt(300)
    assert precision == "float32" or error.any()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_row_knows_nothing_of_the_others(precision):
    louder = FEATURES.copy()
    louder[1:] *= 100
    found, alone = (multiplied(precision, x)[0] for x in (louder, FEATURES[:1]))
    np.testing.assert_allclose(found, alone, atol=1e-4)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_zeros_add_nothing(precision):
    quiet = np.zeros_like(FEATURES)
    np.testing.assert_array_equal(multiplied(precision, quiet), 0.0)
    quiet[..., 0] = 1.0  # one feature alone, in steps that it is a multiple of
    found = multiplied(precision, quiet)
    np.testing.assert_allclose(found, quiet @ KERNEL, atol=np.abs(KERNEL).max() / 100)


def _model(weights: TensorProto) -> ModelProto:
    x, y = (helper.make_tensor_value_info(name, 1, [1, 3]) for name in "xy")
    node = helper.make_node("Mul", ["x", "w"], ["y"])
    return helper.make_model(helper.make_graph([node], "g", [x], [y], [weights]))


def test_arrays_of_another_size_or_elsewhere_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "graph.onnx"
    good = numpy_helper.from_array(np.ones((1, 3), np.float32), "w")
    path.write_bytes(_model(good).SerializeToString())
    assert held_arrays(path)["w"].tolist() == [[1, 1, 1]]
    short, elsewhere = TensorProto(), TensorProto()
    short.CopyFrom(good)
    short.dims[1] = 6
    elsewhere.CopyFrom(good)
    elsewhere.ClearField("raw_data")
    elsewhere.data_location = TensorProto.EXTERNAL
    elsewhere.external_data.add(key="location", value="/etc/passwd")
    for weights in (short, elsewhere):
        path.write_bytes(_model(weights).SerializeToString())
        with pytest.raises(DsnetError, match="does not load"):
            held_arrays(path)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(DsnetError, match="does not load"):
            held_arrays(path)
