"""Posing a body as parts of an ONNX graph: bones, blend shapes and skinning of Eq. 1-2.

What `bridge.body.posing` computes vertex by vertex in float64. Vertices are the last axis, (B, 3,
V), so that each step is one matrix product or a row of multiplications. theta has no hands: they
stay at rest, where their bones move with the wrists', so their weights are the wrists'.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import N_JOINTS
from bridge.runtime.graphs.bones_graph import BONES, TURNING
from bridge.runtime.graphs.onnx_kernels import Precision, product
from bridge.runtime.graphs.onnx_values import Value, ValueGraph


@dataclass(frozen=True, eq=False)
class Surface:
    """Some vertices of a body as arrays of a graph."""

    moved: Callable[[Value, Value], Value]
    """R - I (B, 189) and betas (B, 10 + E) to what they move, (B, 3 V)."""
    template: Value
    """(3 V,)."""
    weights: Value
    """(23, V) of the bones."""
    count: int
    """V."""

    def rest(self, turning: Value, shape: Value) -> Value:
        """(B, 3, V) the rest pose, metres, of R - I (B, 189) and betas (B, 10 + E)."""
        return (self.moved(turning, shape) + self.template).reshape(0, 3, -1)

    def skinned(self, bones: Value, rest: Value) -> Value:
        """(B, V, 3) a rest pose (B, 3, V), turned and moved by bones (B, 12, 23)."""

        def few(bones: Value, rest: Value) -> Value:
            *columns, shift = (part @ self.weights for part in bones.split(1, [3, 3, 3, 3]))
            return turned(columns, shift, rest, axis=1)

        return rest.graph.in_groups([bones, rest], few, (3, self.count)).transpose(0, 2, 1)


def turned(columns: list[Value], shift: Value, rest: Value, axis: int) -> Value:
    """R x + t of places, where `columns` are those of R; `axis` is that of x, y, z."""
    for column, coordinate in zip(columns, rest.split(axis, [1, 1, 1]), strict=True):
        shift = shift + column * coordinate
    return shift


def surface(
    graph: ValueGraph,
    body: BodyModelData,
    vertices: slice | NDArray,
    extra: NDArray | None = None,
    precision: Precision = "float32",
) -> Surface:
    """Some vertices of a body; `extra` (E, V, 3) moves them as the shapes of betas do."""
    by_pose = body.posedirs[vertices].transpose(2, 1, 0)[:TURNING]  # (189, 3, V)
    shapes = body.shapedirs[vertices].transpose(2, 1, 0)
    if extra is not None:
        shapes = np.concatenate([shapes, extra.transpose(0, 2, 1)])
    return Surface(
        _moved(graph, by_pose, shapes, precision),
        graph.array("template", body.v_template[vertices].T.ravel()),
        graph.array("weights", bone_weights(body)[vertices].T),
        by_pose.shape[-1],
    )


def _moved(
    graph: ValueGraph, by_pose: NDArray, shapes: NDArray, precision: Precision
) -> Callable[[Value, Value], Value]:
    """What pose (189, 3, V) and shapes (10 + E, 3, V) move; at full precision by one product."""
    by_pose, shapes = (array.reshape(len(array), -1) for array in (by_pose, shapes))
    if precision == "float32":
        both = graph.array("blendshapes", np.concatenate([by_pose, shapes]))
        return lambda turning, shape: graph.concat([turning, shape], 1) @ both
    posing = product(graph, "posedirs", by_pose, precision)
    held = graph.array("shapedirs", shapes)
    return lambda turning, shape: posing(turning) + shape @ held


def bone_weights(body: BodyModelData) -> NDArray[np.float64]:
    """(V, 23) skinning weights of the joints that theta has, and zeros for the one at rest."""
    weights = np.zeros((body.vertex_count, BONES))
    for joint, column in enumerate(body.weights.T):
        while joint >= N_JOINTS:
            joint = body.parents[joint]
        weights[:, joint] += column
    return weights
