"""A predictor's step as a graph of whole clips, by ONNX's `Scan`."""

from __future__ import annotations

import numpy as np
import onnx

from bridge.paper import THETA_SIZE
from dsnet.onnx.onnx_graph import Graph


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
    given = {value.name: value for value in step.graph.input}
    *shown, next_state = step.graph.output
    body = onnx.GraphProto()
    body.CopyFrom(step.graph)
    del body.input[:], body.output[:]
    body.input.extend([given["state"], given["theta"]])  # betas are those of the graph around it
    body.output.extend([next_state, *shown])

    graph = Graph()
    theta = graph.input("theta", ("T", "B", THETA_SIZE))
    graph.input("betas", _shape(given["betas"]))
    with graph.section("clip"):  # the names below are none of the step's
        size, last, end, first = (
            graph.array(name, [number], np.int64)
            for name, number in (
                ("size", _shape(given["state"])[1]),
                ("last", -1),
                ("end", np.iinfo(np.int32).max),
                ("first", late),
            )
        )
        people = graph.apply("Shape", theta, start=1, end=2)
        begin = graph.apply("ConstantOfShape", graph.concat([people, size], 0))
        whole = graph.concat([theta, *[graph.apply("Slice", theta, last, end)] * late], 0)
        _, *frames = graph.apply_many(
            "Scan", 1 + len(shown), begin, whole, body=body, num_scan_inputs=1
        )
        outputs = {
            value.name: graph.apply("Slice", each, first, end)
            for value, each in zip(shown, frames, strict=True)
        }
    return graph.model(
        f"{step.graph.name}_clip",
        outputs,
        {value.name: ("T", *_shape(value)) for value in shown},
        {name: text for name, text in about.items() if not name.startswith("state")},
    )


def _shape(value: onnx.ValueInfoProto) -> list[int | str]:
    return [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
