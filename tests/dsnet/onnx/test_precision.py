"""Graphs of values: kernels in fewer bits."""

from __future__ import annotations

import numpy as np
import pytest

from dsnet.onnx import precision as precision_module
from dsnet.onnx.onnx_graph import Graph, GraphSession
from dsnet.onnx.precision import PRECISIONS, product

RNG = np.random.default_rng(0)
KERNEL = RNG.normal(size=(300, 400)).astype(np.float32)
FEATURES = RNG.normal(size=(3, 9, 300)).astype(np.float32)


@pytest.fixture(autouse=True)
def everything_is_large(monkeypatch):
    monkeypatch.setattr(precision_module, "_LARGE", 0)


def multiplied(precision, features: np.ndarray) -> np.ndarray:
    graph = Graph()
    found = product(graph, "kernel", KERNEL, precision)(graph.input("x", ("B", 9, 300)))
    model = graph.model("product", {"y": found}, {"y": ("B", 9, 400)})
    return GraphSession(model)(x=features)["y"]


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
