"""Matrix products inside an ONNX graph, with kernels in fewer bits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from onnx import TensorProto

from dsnet.onnx.onnx_graph import Graph, Value

Precision = Literal["float32", "float16", "int8"]
"""Precision of a graph's large kernels. `float16` halves the file; the runtime widens the numbers
when it opens the file, so the speed is that of float32. `int8` stores the largest kernels as bytes,
as reading them takes most of the time for one character, and the others as `float16`: they take
little time, and as bytes they would cause most of the error."""
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
Product = Callable[[Value], Value]
"""Maps (..., I) to (..., O)."""
_SMALL, _LARGE = 1 << 16, 3_000_000
"""Kernels with fewer numbers than the first stay float32; from the second on they may be bytes. The
pose blend shapes have 3.9 million, the decoder's last convolution 13.8."""
_ZERO_BYTE, _KERNEL_STEPS, _ROW_STEPS, _TINY = 128, 127.0, 254.0, 1e-30
"""The byte of a kernel's zero; steps from it to the largest number; steps from the least to the
largest number of a row, one fewer than bytes allow, as both ends are rounded; a least divisor."""


def product(graph: Graph, name: str, kernel: ArrayLike, precision: Precision) -> Product:
    """A function that multiplies by a kernel (I, O), which the graph stores as `name`."""
    kernel = np.asarray(kernel, np.float32)
    if precision == "float32" or kernel.size < _SMALL:
        stored = graph.array(name, kernel)
        return lambda features: features @ stored
    if precision == "int8" and kernel.size >= _LARGE:
        return _in_bytes(graph, name, kernel)
    half = graph.array(name, kernel, np.float16)
    return lambda features: features @ graph.apply("Cast", half, to=TensorProto.FLOAT)


def _in_bytes(graph: Graph, name: str, kernel: NDArray[np.float32]) -> Product:
    """Multiplication with kernel and features as bytes, by a step size for each column and row.

    Each row of features has its own step size, so that the characters of a batch do not affect each
    other. All bytes are unsigned: sums of signed ones overflow on processors without VNNI.
    """
    steps = np.maximum(np.abs(kernel).max(axis=0), _TINY) / _KERNEL_STEPS
    counts = np.rint(kernel / steps)
    stored = graph.array(name, counts + _ZERO_BYTE, np.uint8)
    kernel_zero = graph.array(f"{name}_zero", _ZERO_BYTE, np.uint8)
    feature_zero = graph.array(f"{name}_least", 0, np.uint8)
    column_steps = graph.array(f"{name}_steps", steps)
    column_sums = graph.array(f"{name}_sums", counts.sum(axis=0))

    def apply(features: Value) -> Value:
        least = graph.apply("Min", features.min(-1), 0.0)
        most = graph.apply("Max", features.max(-1), 0.0)
        row_steps = graph.apply("Max", most - least, _TINY) / _ROW_STEPS
        # Zero is a whole number of steps from the least number, so that 0 is represented exactly.
        zero = graph.apply("Round", -least / row_steps)
        counted = graph.apply("Round", features / row_steps) + zero
        counted = graph.apply("Cast", counted, to=TensorProto.UINT8)
        summed = graph.apply("MatMulInteger", counted, stored, feature_zero, kernel_zero)
        summed = graph.apply("Cast", summed, to=TensorProto.FLOAT)
        return (summed - zero * column_sums) * row_steps * column_steps

    return apply
