"""Builds and runs ONNX graphs: values with NumPy's operators, conditional and repeated blocks."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
import onnxruntime
from numpy.typing import ArrayLike, DTypeLike, NDArray
from onnx import TensorProto, helper, numpy_helper

OPSET, IR_VERSION = 17, 8
"""Old versions, so that runtimes of the last years can open the graphs."""
Shape = Sequence[int | str]
_GROUP = 4


def _operator(op: str) -> Callable[[Value, Operand], Value]:
    return lambda left, right: left.graph.apply(op, left, right)


@dataclass(frozen=True, eq=False)
class Value:
    """A tensor of a graph under construction; the operators are NumPy's, broadcasting included."""

    graph: Graph
    name: str

    __add__, __sub__ = _operator("Add"), _operator("Sub")
    __mul__, __truediv__ = _operator("Mul"), _operator("Div")
    __matmul__, __gt__ = _operator("MatMul"), _operator("Greater")

    def __rmul__(self, other: float) -> Value:
        return self.graph.apply("Mul", other, self)

    def __radd__(self, other: float) -> Value:
        return self.graph.apply("Add", other, self)

    def __neg__(self) -> Value:
        return self.graph.apply("Neg", self)

    def sum(self, axis: int) -> Value:
        """Over one axis, which stays with the size 1."""
        return self.graph.apply("ReduceSum", self, self.graph.integers([axis]), keepdims=1)

    def max(self, *axes: int) -> Value:
        """Over axes that stay with the size 1."""
        return self.graph.apply("ReduceMax", self, axes=axes, keepdims=1)

    def min(self, *axes: int) -> Value:
        """Over axes that stay with the size 1."""
        return self.graph.apply("ReduceMin", self, axes=axes, keepdims=1)

    def clip(self, least: float, most: float) -> Value:
        return self.graph.apply("Clip", self, least, most)

    def reshape(self, *shape: int) -> Value:
        """As in ONNX: 0 keeps the size of an axis, -1 is inferred."""
        return self.graph.apply("Reshape", self, self.graph.integers(shape))

    def transpose(self, *axes: int) -> Value:
        return self.graph.apply("Transpose", self, perm=axes)

    def gather(self, indices: NDArray[np.integer] | Value, axis: int) -> Value:
        if not isinstance(indices, Value):
            indices = self.graph.integers(indices)
        return self.graph.apply("Gather", self, indices, axis=axis)

    def part(self, axis: int, start: int, stop: int) -> Value:
        bounds = (self.graph.integers([number]) for number in (start, stop, axis))
        return self.graph.apply("Slice", self, *bounds)

    def split(self, axis: int, sizes: Sequence[int]) -> list[Value]:
        """Consecutive pieces along an axis; no size may be 0."""
        return self.graph.apply_many(
            "Split", len(sizes), self, self.graph.integers(sizes), axis=axis
        )


Operand = Value | float


class Graph:
    """Builds a float32 graph of `Value`s, whose names begin with that of their section.

    Parameters
    ----------
    control_flow : whether it may hold `Loop` and `Scan`. Without them, blocks that repeat are
        written out, for runtimes that have no such operators.
    """

    def __init__(self, control_flow: bool = True) -> None:
        self._control_flow = control_flow
        self._inputs: list[onnx.ValueInfoProto] = []
        self._nodes: list[onnx.NodeProto] = []
        self._arrays: list[onnx.TensorProto] = []
        self._section, self._count = "", 0
        self._constants: dict[tuple[Any, ...], Value] = {}

    def input(self, name: str, shape: Shape) -> Value:
        """Declare an input; axes named by a string may have any size."""
        self._inputs.append(_info(name, TensorProto.FLOAT, shape))
        return Value(self, name)

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Operations and arrays inside the block are named `<name>/...`."""
        outer, self._section = self._section, f"{name}/"
        yield
        self._section = outer

    def array(self, name: str, values: ArrayLike, dtype: DTypeLike = np.float32) -> Value:
        """Add a constant array, named below the section."""
        name = f"{self._section}{name}"
        self._arrays.append(numpy_helper.from_array(np.asarray(values, dtype, order="C"), name))
        return Value(self, name)

    def integers(self, values: ArrayLike) -> Value:
        """Indices or shapes as a constant; equal ones are stored once."""
        return self._constant(np.asarray(values, np.int64))

    def apply(self, op: str, *inputs: Operand, **attributes: Any) -> Value:
        """Apply an operation with one output."""
        return self.apply_many(op, 1, *inputs, **attributes)[0]

    def apply_many(self, op: str, count: int, *inputs: Operand, **attributes: Any) -> list[Value]:
        given = [self._value(operand).name for operand in inputs]
        outputs = [self._name(op) for _ in range(count)]
        self._nodes.append(helper.make_node(op, given, outputs, **attributes))
        return [Value(self, output) for output in outputs]

    def concat(self, values: Sequence[Value], axis: int) -> Value:
        return self.apply("Concat", *values, axis=axis) if len(values) > 1 else values[0]

    def choose(
        self, condition: Value, then: Callable[[], Value], otherwise: Callable[[], Value]
    ) -> Value:
        """The result of one of two blocks; the other one is not computed."""
        branches = {}
        for name, block in (("then_branch", then), ("else_branch", otherwise)):
            with self._inner() as nodes:
                result = _info(self.apply("Identity", block()).name, TensorProto.FLOAT)
            branches[name] = helper.make_graph(nodes, f"{self._section}{name}", [], [result])
        return self.apply("If", condition, **branches)

    def repeat(
        self,
        most: int,
        start: Sequence[Value],
        body: Callable[..., tuple[Value, Sequence[Value]]],
        written_out: int,
    ) -> list[Value]:
        """Repeat a block at most `most` times, until its condition is false.

        `body` takes the values, at first `start`, and gives the condition and the next values.
        Without control flow it is there `written_out` times, whatever the condition.
        """
        if not self._control_flow:
            values = [*start]
            for _ in range(written_out):
                _, values = body(*values)
            return [*values]
        given = [Value(self, self._name("before")) for _ in start]
        iteration, go_on = self._name("turn"), self._name("go_on")
        with self._inner() as nodes:
            condition, after = body(*given)
            results = [self.apply("Identity", value) for value in (condition, *after)]
        inputs = [_info(iteration, TensorProto.INT64, []), _info(go_on, TensorProto.BOOL, [])]
        inputs += [_info(value.name, TensorProto.FLOAT) for value in given]
        outputs = [_info(results[0].name, TensorProto.BOOL, [])]
        outputs += [_info(value.name, TensorProto.FLOAT) for value in results[1:]]
        graph = helper.make_graph(nodes, f"{self._section}body", inputs, outputs)
        at_first = self._constant(np.array(True))
        return self.apply_many(
            "Loop", len(start), self.integers(most), at_first, *start, body=graph
        )

    def in_groups(
        self, values: Sequence[Value], block: Callable[..., Value], shape: Sequence[int]
    ) -> Value:
        """The result (B, *shape) of a block, applied to a few rows of values (B, ...) at a time.

        A group has the largest number of rows up to four that divides B: few enough for the
        intermediate results to stay in the cache, enough to use several threads. Without control
        flow it is applied to all rows together.
        """
        if not self._control_flow:
            return block(*values)
        rows = self.apply("Shape", values[0], start=0, end=1)
        sizes = self.integers(range(1, _GROUP + 1))
        divides = self.apply("Equal", self.apply("Mod", rows, sizes), self.integers(0))
        fitting = self.apply("Where", divides, sizes, self.integers(1))
        size = self.apply("ReduceMax", fitting, keepdims=1)
        leading = [self.apply("Div", rows, size), size]
        row_shapes = [self.apply("Shape", value, start=1) for value in values]
        grouped = [
            self.apply("Reshape", value, self.concat([*leading, row_shape], 0))
            for value, row_shape in zip(values, row_shapes, strict=True)
        ]
        with self._inner() as nodes:
            given = [Value(self, self._name("group")) for _ in values]
            result = self.apply("Identity", block(*given))
        inputs = [_info(value.name, TensorProto.FLOAT) for value in given]
        outputs = [_info(result.name, TensorProto.FLOAT, ("G", *shape))]
        body = helper.make_graph(nodes, f"{self._section}group", inputs, outputs)
        whole = self.apply("Scan", *grouped, body=body, num_scan_inputs=len(values))
        return whole.reshape(-1, *shape)

    def model(
        self,
        name: str,
        outputs: Mapping[str, Value],
        shapes: Mapping[str, Shape] | None = None,
        metadata: Mapping[str, str] | None = None,
        *,
        checked: bool = True,
    ) -> onnx.ModelProto:
        """The finished model.

        Parameters
        ----------
        shapes : of outputs, if they are to be declared.
        metadata : further facts for a reader, as texts by name.
        checked : infer all shapes and check the model; ONNX Runtime checks it anyway when it runs.
        """
        for output, value in outputs.items():
            self._nodes.append(helper.make_node("Identity", [value.name], [output]))
        infos = [_info(name, TensorProto.FLOAT, (shapes or {}).get(name)) for name in outputs]
        nodes, arrays = self._nodes, self._arrays
        if not self._control_flow:
            nodes, arrays = self._needed(outputs)
        graph = helper.make_graph(nodes, name, self._inputs, infos, arrays)
        model = helper.make_model(
            graph,
            ir_version=IR_VERSION,
            opset_imports=[helper.make_opsetid("", OPSET)],
            producer_name="dsnet",
        )
        helper.set_model_props(model, dict(metadata or {}))
        if checked:
            model = onnx.shape_inference.infer_shapes(model)
            onnx.checker.check_model(model)
        return model

    def _needed(
        self, outputs: Iterable[str]
    ) -> tuple[list[onnx.NodeProto], list[onnx.TensorProto]]:
        """Nodes and arrays that the outputs depend on; not every runtime leaves out the others."""
        names, nodes = {*outputs}, []
        for node in reversed(self._nodes):
            if names & {*node.output}:
                names |= {*node.input}
                nodes.insert(0, node)
        return nodes, [array for array in self._arrays if array.name in names]

    @contextmanager
    def _inner(self) -> Iterator[list[onnx.NodeProto]]:
        """Collect the operations of the block in a separate list, for a branch or a loop's body."""
        outer, self._nodes = self._nodes, []
        yield self._nodes
        self._nodes = outer

    def _value(self, operand: Operand) -> Value:
        return operand if isinstance(operand, Value) else self._constant(np.float32(operand))

    def _constant(self, values: ArrayLike) -> Value:
        array = np.asarray(values)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._constants:
            name = f"constants/{len(self._constants)}"
            self._arrays.append(numpy_helper.from_array(array, name))
            self._constants[key] = Value(self, name)
        return self._constants[key]

    def _name(self, op: str) -> str:
        self._count += 1
        return f"{self._section or 'graph/'}{op}_{self._count}"


def _info(name: str, kind: int, shape: Shape | None = None) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


@dataclass(frozen=True)
class StateLayout:
    """How named arrays lie in a graph's state, one row a character; a row is zeros at first.

    None of the arrays is empty.
    """

    shapes: Mapping[str, tuple[int, ...]]
    """Shape of each array of one character, in the order of the row."""

    @property
    def size(self) -> int:
        return sum(map(math.prod, self.shapes.values()))

    def columns(self, name: str) -> slice:
        """The columns of an array in a row."""
        before = list(self.shapes.values())[: list(self.shapes).index(name)]
        start = sum(map(math.prod, before))
        return slice(start, start + math.prod(self.shapes[name]))

    def read(self, state: Value) -> dict[str, Value]:
        """Arrays (B, ...) of a state (B, S)."""
        parts = state.split(1, [math.prod(shape) for shape in self.shapes.values()])
        return {
            name: part.reshape(0, *shape)
            for (name, shape), part in zip(self.shapes.items(), parts, strict=True)
        }

    def written(self, graph: Graph, arrays: Mapping[str, Value]) -> Value:
        """The state (B, S) of all arrays (B, ...)."""
        rows = [arrays[n].reshape(-1, math.prod(shape)) for n, shape in self.shapes.items()]
        return graph.concat(rows, 1)

    def as_text(self) -> str:
        """JSON: [name, first column, shape] of each array."""
        entries = self.shapes.items()
        return json.dumps([[name, self.columns(name).start, list(s)] for name, s in entries])


class GraphSession:
    """Runs a graph by ONNX Runtime on the CPU; when `threads` is 0, the runtime chooses."""

    def __init__(self, model: onnx.ModelProto, threads: int = 0) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        self._session = onnxruntime.InferenceSession(
            model.SerializeToString(), options, providers=["CPUExecutionProvider"]
        )
        self._names = [output.name for output in self._session.get_outputs()]
        self.input_shapes: dict[str, list[Any]] = {
            given.name: given.shape for given in self._session.get_inputs()
        }

    def __call__(self, **inputs: NDArray) -> dict[str, NDArray]:
        """Outputs of the graph by name."""
        outputs = map(np.asarray, self._session.run(self._names, inputs))
        return dict(zip(self._names, outputs, strict=True))

    def rollout(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """Vertices (T, B, V, 3), metres, of poses theta (T, B, 69) and betas (B, S).

        The graph is a predictor with its body; its state is zero before the first pose.
        """
        state, frames = np.zeros((len(betas), self.input_shapes["state"][1]), np.float32), []
        for poses in theta:
            outputs = self(theta=poses, betas=betas, state=state)
            state = outputs["next_state"]
            frames.append(outputs["vertices"])
        return np.stack(frames)
