"""Matrix products whose large kernels a graph may hold in fewer bits.

`float16` halves the file; the runtime widens the numbers when it opens it, so speed stays. `int8`
holds the largest as bytes, which is what a product for one character waits for, and the others as
`float16`: they take little time, and in bytes they would cost most of the error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from onnx import TensorProto

from bridge.runtime.graphs.onnx_values import Value, ValueGraph

Precision = Literal["float32", "float16", "int8"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
Product = Callable[[Value], Value]
"""(..., I) to (..., O)."""
_SMALL, _LARGE = 1 << 16, 3_000_000
"""Numbers below which a kernel stays float32, and from which on it may be bytes: the pose blend
shapes have 3.9 million, the decoder's last convolution 13.8."""
_MIDDLE, _REACH, _STEPS, _TINY = 128, 127.0, 254.0, 1e-30
"""A kernel's byte of zero, and the steps from there to its largest number; steps from a row's
least number to its largest, one fewer than bytes have, as both ends are rounded; and none."""


def product(graph: ValueGraph, name: str, kernel: ArrayLike, precision: Precision) -> Product:
    """Multiplication by a kernel (I, O) that the graph holds as `name`."""
    kernel = np.asarray(kernel, np.float32)
    if precision == "float32" or kernel.size < _SMALL:
        held = graph.array(name, kernel)
        return lambda features: features @ held
    if precision == "int8" and kernel.size >= _LARGE:
        return _in_bytes(graph, name, kernel)
    half = graph.raw(name, kernel.astype(np.float16))
    return lambda features: features @ graph.apply("Cast", half, to=TensorProto.FLOAT)


def _in_bytes(graph: ValueGraph, name: str, kernel: NDArray[np.float32]) -> Product:
    """Kernel and features as bytes: steps for each column of one and each row of the other.

    A row's steps, from its least number to its largest, are its own, so that characters of one
    batch do not change each other. Bytes of both are unsigned: sums of signed ones overflow in the
    instructions of processors without VNNI.
    """
    steps = np.maximum(np.abs(kernel).max(axis=0), _TINY) / _REACH
    counts = np.rint(kernel / steps)
    held = graph.raw(name, (counts + _MIDDLE).astype(np.uint8))
    middle = graph.raw(f"{name}_zero", np.array(_MIDDLE, np.uint8))
    nothing = graph.raw(f"{name}_least", np.array(0, np.uint8))
    column_steps = graph.array(f"{name}_steps", steps)
    column_sums = graph.array(f"{name}_sums", counts.sum(axis=0))

    def apply(features: Value) -> Value:
        least = graph.apply("Min", features.min(-1), 0.0)
        most = graph.apply("Max", features.max(-1), 0.0)
        row_steps = graph.apply("Max", most - least, _TINY) / _STEPS
        # Zero is a whole number of steps from the least: what does not move stays unmoved.
        zero = graph.apply("Round", -least / row_steps)
        counted = graph.apply("Round", features / row_steps) + zero
        counted = graph.apply("Cast", counted, to=TensorProto.UINT8)
        summed = graph.apply("MatMulInteger", counted, held, nothing, middle)
        summed = graph.apply("Cast", summed, to=TensorProto.FLOAT)
        return (summed - zero * column_sums) * row_steps * column_steps

    return apply
