"""Formulas as ONNX graphs: values with NumPy's operators, blocks that are run if needed or
repeated, matrix products in fewer bits, and how a graph is run."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import onnx
import onnxruntime
from numpy.typing import ArrayLike, DTypeLike, NDArray
from onnx import TensorProto, helper, numpy_helper

OPSET, IR_VERSION = 17, 8
"""Old enough for the runtimes of the last years; nothing newer is used."""
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
        """As ONNX's: 0 keeps an axis, -1 is what is left."""
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
        """Pieces that follow one another on an axis; none of size 0."""
        return self.graph.apply_many(
            "Split", len(sizes), self, self.graph.integers(sizes), axis=axis
        )


Operand = Value | float


class Graph:
    """Builds a float32 graph of `Value`s, each with a name below that of its section."""

    def __init__(self) -> None:
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
        """Name what is applied and held meanwhile `<name>/...`."""
        outer, self._section = self._section, f"{name}/"
        yield
        self._section = outer

    def array(self, name: str, values: ArrayLike, dtype: DTypeLike = np.float32) -> Value:
        """Hold numbers, below the section's name."""
        name = f"{self._section}{name}"
        self._arrays.append(numpy_helper.from_array(np.asarray(values, dtype, order="C"), name))
        return Value(self, name)

    def integers(self, values: ArrayLike) -> Value:
        """Indices or shapes; equal ones are held once."""
        return self._constant(np.asarray(values, np.int64))

    def apply(self, op: str, *inputs: Operand, **attributes: Any) -> Value:
        """One operation with one output."""
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
        """One of two blocks, of which only that is computed."""
        branches = {}
        for name, block in (("then_branch", then), ("else_branch", otherwise)):
            with self._inner() as nodes:
                result = _info(self.apply("Identity", block()).name, TensorProto.FLOAT)
            branches[name] = helper.make_graph(nodes, f"{self._section}{name}", [], [result])
        return self.apply("If", condition, **branches)

    def repeat(
        self, most: int, start: Sequence[Value], body: Callable[..., tuple[Value, Sequence[Value]]]
    ) -> list[Value]:
        """Repeat a block until it says that it is done, at most so many times.

        `body` makes of the values, which are `start` at first, whether to go on, and the next.
        """
        given = [Value(self, self._name("before")) for _ in start]
        turn, go_on = self._name("turn"), self._name("go_on")
        with self._inner() as nodes:
            wanted, after = body(*given)
            results = [self.apply("Identity", value) for value in (wanted, *after)]
        inputs = [_info(turn, TensorProto.INT64, []), _info(go_on, TensorProto.BOOL, [])]
        inputs += [_info(value.name, TensorProto.FLOAT) for value in given]
        outputs = [_info(results[0].name, TensorProto.BOOL, [])]
        outputs += [_info(value.name, TensorProto.FLOAT) for value in results[1:]]
        graph = helper.make_graph(nodes, f"{self._section}body", inputs, outputs)
        forever = self._constant(np.array(True))
        return self.apply_many("Loop", len(start), self.integers(most), forever, *start, body=graph)

    def in_groups(
        self, values: Sequence[Value], block: Callable[..., Value], shape: Sequence[int]
    ) -> Value:
        """(B, *shape) what a block makes of values (B, ...), some rows of each at a time.

        Rows of a group are as many as divide B, four at most: few enough that what a block makes
        meanwhile stays in a processor's cache, enough for its threads to share.
        """
        rows = self.apply("Shape", values[0], start=0, end=1)
        sizes = self.integers(range(1, _GROUP + 1))
        divides = self.apply("Equal", self.apply("Mod", rows, sizes), self.integers(0))
        fitting = self.apply("Where", divides, sizes, self.integers(1))
        size = self.apply("ReduceMax", fitting, keepdims=1)
        leading = [self.apply("Div", rows, size), size]
        own = [self.apply("Shape", value, start=1) for value in values]
        grouped = [
            self.apply("Reshape", value, self.concat([*leading, sizes], 0))
            for value, sizes in zip(values, own, strict=True)
        ]
        with self._inner() as nodes:
            given = [Value(self, self._name("group")) for _ in values]
            found = self.apply("Identity", block(*given))
        inputs = [_info(value.name, TensorProto.FLOAT) for value in given]
        outputs = [_info(found.name, TensorProto.FLOAT, ("G", *shape))]
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
        """The model.

        Parameters
        ----------
        shapes : of outputs, where they are to be declared.
        metadata : what else a reader should know, texts by name.
        checked : infer shapes within and check it; what is run at once the runtime checks.
        """
        for output, value in outputs.items():
            self._nodes.append(helper.make_node("Identity", [value.name], [output]))
        infos = [_info(name, TensorProto.FLOAT, (shapes or {}).get(name)) for name in outputs]
        graph = helper.make_graph(self._nodes, name, self._inputs, infos, self._arrays)
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

    @contextmanager
    def _inner(self) -> Iterator[list[onnx.NodeProto]]:
        """Put what is applied meanwhile into a list of its own, for a branch or a loop's body."""
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
    """A graph's state: one row a character, of named arrays side by side; zeros where she begins.

    None of the arrays is empty.
    """

    shapes: Mapping[str, tuple[int, ...]]
    """Of each array of one character, in the row's order."""

    @property
    def size(self) -> int:
        return sum(map(math.prod, self.shapes.values()))

    def columns(self, name: str) -> slice:
        """Where an array lies in a row."""
        before = list(self.shapes.values())[: list(self.shapes).index(name)]
        start = sum(map(math.prod, before))
        return slice(start, start + math.prod(self.shapes[name]))

    def read(self, state: Value) -> dict[str, Value]:
        """The arrays (B, ...) of a state (B, S)."""
        parts = state.split(1, [math.prod(shape) for shape in self.shapes.values()])
        return {
            name: part.reshape(0, *shape)
            for (name, shape), part in zip(self.shapes.items(), parts, strict=True)
        }

    def written(self, graph: Graph, arrays: Mapping[str, Value]) -> Value:
        """(B, S) of all arrays (B, ...)."""
        rows = [arrays[n].reshape(-1, math.prod(shape)) for n, shape in self.shapes.items()]
        return graph.concat(rows, 1)

    def as_text(self) -> str:
        """JSON: [name, first column, shape] of each array."""
        entries = self.shapes.items()
        return json.dumps([[name, self.columns(name).start, list(s)] for name, s in entries])


Precision = Literal["float32", "float16", "int8"]
"""Of a graph's large kernels. `float16` halves the file; the runtime widens the numbers when it
opens it, so speed stays. `int8` holds the largest as bytes, which is what a product for one
character waits for, and the others as `float16`: they take little time, and in bytes they would
cost most of the error."""
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
Product = Callable[[Value], Value]
"""(..., I) to (..., O)."""
_SMALL, _LARGE = 1 << 16, 3_000_000
"""Numbers below which a kernel stays float32, and from which on it may be bytes: the pose blend
shapes have 3.9 million, the decoder's last convolution 13.8."""
_MIDDLE, _REACH, _STEPS, _TINY = 128, 127.0, 254.0, 1e-30
"""A kernel's byte of zero, and the steps from there to its largest number; steps from a row's
least number to its largest, one fewer than bytes have, as both ends are rounded; and none."""


def product(graph: Graph, name: str, kernel: ArrayLike, precision: Precision) -> Product:
    """Multiplication by a kernel (I, O) that the graph holds as `name`."""
    kernel = np.asarray(kernel, np.float32)
    if precision == "float32" or kernel.size < _SMALL:
        held = graph.array(name, kernel)
        return lambda features: features @ held
    if precision == "int8" and kernel.size >= _LARGE:
        return _in_bytes(graph, name, kernel)
    half = graph.array(name, kernel, np.float16)
    return lambda features: features @ graph.apply("Cast", half, to=TensorProto.FLOAT)


def _in_bytes(graph: Graph, name: str, kernel: NDArray[np.float32]) -> Product:
    """Kernel and features as bytes: steps for each column of one and each row of the other.

    A row's steps, from its least number to its largest, are its own, so that characters of one
    batch do not change each other. Bytes of both are unsigned: sums of signed ones overflow in the
    instructions of processors without VNNI.
    """
    steps = np.maximum(np.abs(kernel).max(axis=0), _TINY) / _REACH
    counts = np.rint(kernel / steps)
    held = graph.array(name, counts + _MIDDLE, np.uint8)
    middle = graph.array(f"{name}_zero", _MIDDLE, np.uint8)
    nothing = graph.array(f"{name}_least", 0, np.uint8)
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


class GraphSession:
    """A graph, run by ONNX Runtime on the CPU, with `threads`; the runtime's own choice when 0."""

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
        """The graph's outputs by name, of its inputs."""
        outputs = map(np.asarray, self._session.run(self._names, inputs))
        return dict(zip(self._names, outputs, strict=True))

    def rolled(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """(T, B, V, 3) vertices, metres, by a predictor with its body, of characters who begin in
        the first of the poses theta (T, B, 69), of shapes betas (B, S)."""
        state, frames = np.zeros((len(betas), self.input_shapes["state"][1]), np.float32), []
        for poses in theta:
            found = self(theta=poses, betas=betas, state=state)
            state = found["next_state"]
            frames.append(found["vertices"])
        return np.stack(frames)
