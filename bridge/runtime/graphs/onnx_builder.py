"""What the ONNX graphs of both networks have in common: how one is built, stored and run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
from numpy.typing import DTypeLike, NDArray
from onnx import helper, numpy_helper

from bridge.errors import DsnetError
from bridge.runs.untrusted import damage_refused, open_regular

OPSET, IR_VERSION = 17, 8
"""Old enough for the runtimes of the last years; nothing newer is used."""
Shape = Sequence[int | str]


class GraphBuilder:
    """An ONNX graph under construction.

    A tensor has the name of the layer whose output it is; tensors inside a layer have a `/` in
    their names, `fc_enc_2/product`, as its weights have.
    """

    def __init__(self, dtype: DTypeLike) -> None:
        self._type = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
        self._inputs: list[onnx.ValueInfoProto] = []
        self._nodes: list[onnx.NodeProto] = []
        self._initialisers: list[onnx.TensorProto] = []

    def input(self, name: str, shape: Shape) -> str:
        """Declare an input; axes named by a string may have any size."""
        self._inputs.append(helper.make_tensor_value_info(name, self._type, shape))
        return name

    def hold(self, arrays: Mapping[str, NDArray]) -> None:
        """Store arrays in the graph."""
        for name, array in arrays.items():
            self._initialisers.append(numpy_helper.from_array(np.asarray(array, order="C"), name))

    def node(self, op: str, inputs: Sequence[str], *outputs: str, **attributes: Any) -> str:
        """Apply one operation; the name of its first output."""
        self._nodes.append(helper.make_node(op, inputs, outputs, **attributes))
        return next(output for output in outputs if output)

    @contextmanager
    def inner(self) -> Iterator[list[onnx.NodeProto]]:
        """Put what is applied meanwhile into a list of its own, for a branch or a loop's body."""
        outer, self._nodes = self._nodes, []
        try:
            yield self._nodes
        finally:
            self._nodes = outer

    def linear(self, features: str, layer: str, output: str = "") -> str:
        """A linear layer on the last axis with the arrays `<layer>/kernel` and `<layer>/bias`."""
        product = self.node("MatMul", [features, f"{layer}/kernel"], f"{layer}/product")
        return self.node("Add", [product, f"{layer}/bias"], output or layer)

    def model(
        self,
        name: str,
        outputs: Mapping[str, str],
        *,
        trace: bool = False,
        shapes: Mapping[str, Shape] | None = None,
        metadata: Mapping[str, str] | None = None,
        checked: bool = True,
    ) -> onnx.ModelProto:
        """The model.

        Parameters
        ----------
        name : the graph's name.
        outputs : the tensor of each output.
        trace : give every layer's output too, by the layer's name.
        shapes : of outputs, where they are to be declared.
        metadata : what else a reader should know, texts by name.
        checked : infer shapes within and check it; what is run at once the runtime checks.
        """
        layers = [name for node in self._nodes for name in node.output if name and "/" not in name]
        for output, tensor in outputs.items():
            self.node("Identity", [tensor], output)
        named = [*outputs, *(layer for layer in layers if trace)]
        declared = shapes or {}
        infos = [
            helper.make_tensor_value_info(output, self._type, declared.get(output))
            for output in named
        ]
        graph = helper.make_graph(self._nodes, name, self._inputs, infos, self._initialisers)
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
        """The graph's outputs, and its inputs, are arrays by name."""
        outputs = map(np.asarray, self._session.run(self._names, inputs))
        return dict(zip(self._names, outputs, strict=True))


def save_graph(path: Path, model: onnx.ModelProto) -> None:
    """Write a model as `.onnx`."""
    onnx.save_model(model, path)


def held_arrays(path: Path) -> dict[str, NDArray]:
    """The arrays that a graph in a file holds, by name.

    Raises
    ------
    DsnetError
        If the file is not an ONNX model.
    """

    def refusal(error: Exception) -> DsnetError:
        return DsnetError(
            f"{path}, which does not load ({type(error).__name__})",
            "an ONNX model written by dsnet",
            "Export it again.",
        )

    # protobuf is a dependency of onnx, not ours.
    undecodable = onnx.serialization.google.protobuf.message.DecodeError  # pyright: ignore[reportPrivateImportUsage]
    with damage_refused(refusal, undecodable, onnx.checker.ValidationError):
        with open_regular(path) as stream:
            # From bytes: a model in a file may name other files that hold its arrays.
            model = onnx.load_model_from_string(stream.read())
        onnx.checker.check_model(model)
        return {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
