"""A predictor's step as a graph of whole clips, by ONNX's `Scan`."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from bridge.paper import THETA_SIZE
from dsnet.onnx.onnx_graph import IR_VERSION, OPSET

_END = np.iinfo(np.int32).max


def over_frames(step: onnx.ModelProto) -> onnx.ModelProto:
    """The graph that gives a step all frames of clips, one after another, from a state of zeros.

    Inputs are `theta` (T, B, 69) and `betas` (B, S); outputs are those of the step but the state,
    (T, B, ...). None is late: the last pose stands for those after it, as in whole predictions.

    Parameters
    ----------
    step : inputs `theta` (B, 69), `betas` (B, S) and `state` (B, N); the last output is
        `next_state`, and the metadata have `latency_frames`.
    """
    about = {entry.key: entry.value for entry in step.metadata_props}
    late = int(about.pop("latency_frames"))
    about = {name: text for name, text in about.items() if not name.startswith("state")}
    given = {value.name: value for value in step.graph.input}
    *shown, next_state = step.graph.output
    body = onnx.GraphProto()
    body.CopyFrom(step.graph)
    del body.input[:], body.output[:]
    body.input.extend([given["state"], given["theta"]])  # betas are those of the graph around it
    body.output.extend([next_state, *shown])
    each = [f"clip/{value.name}" for value in shown]
    integers = {
        "size": given["state"].type.tensor_type.shape.dim[1].dim_value,
        "last": -1,
        "late": late,
        "end": _END,
    }
    nodes = [
        helper.make_node("Shape", ["theta"], ["clip/count"], start=1, end=2),
        helper.make_node("Concat", ["clip/count", "size"], ["clip/state_shape"], axis=0),
        helper.make_node("ConstantOfShape", ["clip/state_shape"], ["clip/begin"]),
        helper.make_node("Slice", ["theta", "last", "end"], ["clip/last"]),
        helper.make_node("Concat", ["theta", *["clip/last"] * late], ["clip/theta"], axis=0),
        helper.make_node(
            "Scan",
            ["clip/begin", "clip/theta"],
            ["clip/end", *each],
            body=body,
            num_scan_inputs=1,
        ),
        *(
            helper.make_node("Slice", [name, "late", "end"], [value.name])
            for name, value in zip(each, shown, strict=True)
        ),
    ]
    graph = helper.make_graph(
        nodes,
        f"{step.graph.name}_clip",
        [
            helper.make_tensor_value_info("theta", TensorProto.FLOAT, ("T", "B", THETA_SIZE)),
            given["betas"],
        ],
        [_with_frames(value) for value in shown],
        [numpy_helper.from_array(np.array([n]), name) for name, n in integers.items()],
    )
    model = helper.make_model(
        graph,
        ir_version=IR_VERSION,
        opset_imports=[helper.make_opsetid("", OPSET)],
        producer_name="dsnet",
    )
    helper.set_model_props(model, about)
    onnx.checker.check_model(model)
    return model


def _with_frames(value: onnx.ValueInfoProto) -> onnx.ValueInfoProto:
    """An output (B, ...) of a frame as one (T, B, ...)."""
    shape = [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
    return helper.make_tensor_value_info(value.name, TensorProto.FLOAT, ("T", *shape))
