"""Formulas as ONNX graphs: values with operators, and blocks that are run if needed or repeated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
from numpy.typing import ArrayLike, NDArray
from onnx import TensorProto, helper

from bridge.runtime.graphs.onnx_builder import GraphBuilder, Shape


@dataclass(frozen=True, eq=False)
class Value:
    """A tensor of a graph under construction; the operators are NumPy's, broadcasting included."""

    graph: ValueGraph
    name: str

    def __add__(self, other: Operand) -> Value:
        return self.graph.apply("Add", self, other)

    def __sub__(self, other: Operand) -> Value:
        return self.graph.apply("Sub", self, other)

    def __mul__(self, other: Operand) -> Value:
        return self.graph.apply("Mul", self, other)

    def __truediv__(self, other: Operand) -> Value:
        return self.graph.apply("Div", self, other)

    def __matmul__(self, other: Operand) -> Value:
        return self.graph.apply("MatMul", self, other)

    def __rmul__(self, other: float) -> Value:
        return self.graph.apply("Mul", other, self)

    def __radd__(self, other: float) -> Value:
        return self.graph.apply("Add", other, self)

    def __neg__(self) -> Value:
        return self.graph.apply("Neg", self)

    def __gt__(self, other: Operand) -> Value:
        return self.graph.apply("Greater", self, other)

    def sum(self, axis: int) -> Value:
        """Over one axis, which stays with the size 1."""
        return self.graph.apply("ReduceSum", self, self.graph.integers([axis]), keepdims=1)

    def max(self, *axes: int) -> Value:
        """Over axes that stay with the size 1."""
        return self.graph.apply("ReduceMax", self, axes=axes, keepdims=1)

    def min(self, *axes: int) -> Value:
        """Over axes that stay with the size 1."""
        return self.graph.apply("ReduceMin", self, axes=axes, keepdims=1)

    def reshape(self, *shape: int) -> Value:
        """As ONNX's: 0 keeps an axis, -1 is what is left."""
        return self.graph.apply("Reshape", self, self.graph.integers(shape))

    def transpose(self, *axes: int) -> Value:
        """With the axes in another order."""
        return self.graph.apply("Transpose", self, perm=axes)

    def gather(self, indices: NDArray[np.integer] | Value, axis: int) -> Value:
        """What lies at `indices` of one axis."""
        if not isinstance(indices, Value):
            indices = self.graph.integers(indices)
        return self.graph.apply("Gather", self, indices, axis=axis)

    def part(self, axis: int, start: int, stop: int) -> Value:
        """From `start` to before `stop` on one axis."""
        bounds = (self.graph.integers([number]) for number in (start, stop, axis))
        return self.graph.apply("Slice", self, *bounds)

    def split(self, axis: int, sizes: Sequence[int]) -> list[Value]:
        """Pieces that follow one another on an axis; none of size 0."""
        return self.graph.apply_many(
            "Split", len(sizes), self, self.graph.integers(sizes), axis=axis
        )


Operand = Value | float
_GROUP = 4


class ValueGraph:
    """Builds a float32 graph of `Value`s, each with a name below that of its section."""

    def __init__(self) -> None:
        self._builder = GraphBuilder(np.float32)
        self._section, self._count = "graph", 0
        self._constants: dict[tuple[Any, ...], Value] = {}

    def input(self, name: str, shape: Shape) -> Value:
        """Declare an input."""
        return Value(self, self._builder.input(name, shape))

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Name what is applied meanwhile `<name>/...`."""
        outer, self._section = self._section, name
        yield
        self._section = outer

    def array(self, name: str, values: ArrayLike) -> Value:
        """Hold float32 numbers, below the section's name."""
        name = f"{self._section}/{name}"
        self._builder.hold({name: np.asarray(values, np.float32)})
        return Value(self, name)

    def raw(self, name: str, values: NDArray) -> Value:
        """Hold numbers of any type as they are, below the section's name."""
        name = f"{self._section}/{name}"
        self._builder.hold({name: values})
        return Value(self, name)

    def integers(self, values: ArrayLike) -> Value:
        """Indices or shapes; equal ones are held once."""
        return self._constant(np.asarray(values, np.int64))

    def apply(self, op: str, *inputs: Operand, **attributes: Any) -> Value:
        """One operation with one output."""
        return self.apply_many(op, 1, *inputs, **attributes)[0]

    def apply_many(self, op: str, count: int, *inputs: Operand, **attributes: Any) -> list[Value]:
        """One operation with several outputs."""
        given = [self._value(operand).name for operand in inputs]
        outputs = [self._name(op) for _ in range(count)]
        self._builder.node(op, given, *outputs, **attributes)
        return [Value(self, output) for output in outputs]

    def concat(self, values: Sequence[Value], axis: int) -> Value:
        """Values side by side."""
        return self.apply("Concat", *values, axis=axis) if len(values) > 1 else values[0]

    def choose(
        self, condition: Value, then: Callable[[], Value], otherwise: Callable[[], Value]
    ) -> Value:
        """One of two blocks, of which only that is computed."""
        branches = {}
        for name, block in (("then_branch", then), ("else_branch", otherwise)):
            with self._builder.inner() as nodes:
                result = self.apply("Identity", block())
            branches[name] = helper.make_graph(
                nodes, f"{self._section}/{name}", [], [_info(result.name, TensorProto.FLOAT)]
            )
        return self.apply("If", condition, **branches)

    def repeat(
        self, most: int, start: Sequence[Value], body: Callable[..., tuple[Value, Sequence[Value]]]
    ) -> list[Value]:
        """Repeat a block until it says that it is done, at most so many times.

        Parameters
        ----------
        start : values before the first turn.
        body : from those values, whether to go on, and the values after a turn.
        """
        given = [Value(self, self._name("before")) for _ in start]
        turn, go_on = self._name("turn"), self._name("go_on")
        with self._builder.inner() as nodes:
            wanted, after = body(*given)
            results = [self.apply("Identity", value) for value in (wanted, *after)]
        inputs = [_info(turn, TensorProto.INT64, []), _info(go_on, TensorProto.BOOL, [])]
        inputs += [_info(value.name, TensorProto.FLOAT) for value in given]
        outputs = [_info(results[0].name, TensorProto.BOOL, [])]
        outputs += [_info(value.name, TensorProto.FLOAT) for value in results[1:]]
        graph = helper.make_graph(nodes, f"{self._section}/body", inputs, outputs)
        forever = self._constant(np.array(True))
        return self.apply_many("Loop", len(start), self.integers(most), forever, *start, body=graph)

    def in_groups(
        self, values: Sequence[Value], block: Callable[..., Value], shape: Sequence[int]
    ) -> Value:
        """(B, ...) what a block makes of values (B, ...), some rows of each at a time.

        Rows of a group are as many as divide B, four at most: few enough that what a block makes
        meanwhile stays in a processor's cache, enough for its threads to share.

        Parameters
        ----------
        block : from G rows of each value.
        shape : of what it gives, without G.
        """
        rows = self.apply("Shape", values[0], start=0, end=1)
        sizes = self.integers(range(1, _GROUP + 1))
        left = self.apply("Mod", rows, sizes)
        fitting = self.apply("Where", self.apply("Equal", left, self.integers(0)), sizes,
                             self.integers(1))  # fmt: skip
        size = self.apply("ReduceMax", fitting, keepdims=1)
        leading = [self.apply("Div", rows, size), size]
        grouped = [self._led_by(leading, value) for value in values]
        with self._builder.inner() as nodes:
            given = [Value(self, self._name("group")) for _ in values]
            found = self.apply("Identity", block(*given))
        inputs = [_info(value.name, TensorProto.FLOAT) for value in given]
        outputs = [_info(found.name, TensorProto.FLOAT, ("G", *shape))]
        body = helper.make_graph(nodes, f"{self._section}/group", inputs, outputs)
        whole = self.apply("Scan", *grouped, body=body, num_scan_inputs=len(values))
        return whole.reshape(-1, *shape)

    def model(
        self,
        name: str,
        outputs: Mapping[str, Value],
        shapes: Mapping[str, Shape],
        metadata: Mapping[str, str] | None = None,
        checked: bool = True,
    ) -> onnx.ModelProto:
        """The model; see `GraphBuilder.model`."""
        named = {output: value.name for output, value in outputs.items()}
        return self._builder.model(name, named, shapes=shapes, metadata=metadata, checked=checked)

    def _led_by(self, leading: Sequence[Value], value: Value) -> Value:
        """A value (B, ...) whose first axis is split into others."""
        own = self.apply("Shape", value, start=1)
        return self.apply("Reshape", value, self.concat([*leading, own], 0))

    def _value(self, operand: Operand) -> Value:
        if isinstance(operand, Value):
            return operand
        return self._constant(np.asarray(operand, np.float32))

    def _constant(self, array: NDArray) -> Value:
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._constants:
            name = f"constants/{len(self._constants)}"
            self._builder.hold({name: array})
            self._constants[key] = Value(self, name)
        return self._constants[key]

    def _name(self, op: str) -> str:
        self._count += 1
        return f"{self._section}/{op}_{self._count}"


def _info(name: str, kind: int, shape: Shape | None = None) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)
