"""Posing a body as parts of an ONNX graph: bones, blend shapes and skinning of Eq. 1-2.

What `bridge.body.posing` computes vertex by vertex in float64. Vertices are the last axis, (B, 3,
V), so that each step is one matrix product or a row of multiplications. theta has no hands: they
stay at rest, where their bones move with the wrists', so their weights are the wrists'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import N_JOINTS, THETA_SIZE
from bridge.runtime.graphs.onnx_kernels import Precision, Product, product
from bridge.runtime.graphs.onnx_values import Value, ValueGraph

BONES = N_JOINTS + 1
"""The joints of theta, and one that never moves: the root's parent."""
TURNING = 9 * (N_JOINTS - 1)
"""Pose features, R - I, of the joints that theta has but for the root."""
_SMALL_RAD = 1e-4
"""Half an angle below which its sine is itself in float32."""


@dataclass(frozen=True, eq=False)
class PosedBones:
    """B characters' poses, without their place in the world."""

    bones: Value
    """(B, 12, 23) rest pose to the pose: rows are the columns of [R | t] one after another."""
    features: Value
    """(B, 189) R - I."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Some vertices of a body as arrays of a graph."""

    by_pose: Product
    """(B, 189) R - I to what they move, (B, 3 V)."""
    shapes: Value
    """(10 + E, 3 V) what betas move, and what else there is."""
    template: Value
    """(3 V,)."""
    weights: Value
    """(23, V) of the bones."""
    count: int
    """V."""

    def rest(self, turning: Value, shape: Value) -> Value:
        """(B, 3, V) the rest pose, metres, of R - I (B, 189) and betas (B, 10 + E)."""
        shaped = shape @ self.shapes + self.template
        return (self.by_pose(turning) + shaped).reshape(0, 3, -1)

    def skinned(self, bones: Value, rest: Value) -> Value:
        """(B, V, 3) a rest pose (B, 3, V), turned and moved by bones (B, 12, 23)."""

        def one(bones: Value, rest: Value) -> Value:
            *columns, shift = (bones @ self.weights).split(0, [3, 3, 3, 3])
            return turned(columns, shift, rest, axis=0).transpose(1, 0)

        return rest.graph.for_each([bones, rest], one, (self.count, 3))


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
        product(graph, "posedirs", by_pose.reshape(TURNING, -1), precision),
        graph.array("shapedirs", shapes.reshape(len(shapes), -1)),
        graph.array("template", body.v_template[vertices].T.ravel()),
        graph.array("weights", bone_weights(body)[vertices].T),
        by_pose.shape[-1],
    )


def bone_weights(body: BodyModelData) -> NDArray[np.float64]:
    """(V, 23) skinning weights of the joints that theta has, and zeros for the one at rest."""
    weights = np.zeros((body.vertex_count, BONES))
    for joint, column in enumerate(body.weights.T):
        while joint >= N_JOINTS:
            joint = body.parents[joint]
        weights[:, joint] += column
    return weights


def posed_bones(graph: ValueGraph, body: BodyModelData, theta: Value, betas: Value) -> PosedBones:
    """Bones and pose features of theta (B, 69) and betas (B, 10)."""
    with graph.section("bones"):
        rotations = _rotations(graph, theta)  # (B, 23, 3, 3)
        joints = _joints(graph, body, betas)  # (B, 23, 3, 1)
        own = graph.concat([rotations, joints - rotations @ joints], 3)  # about the joint
        chained = _chained(graph, own, body.parents[:N_JOINTS])
        bones = chained.transpose(0, 3, 2, 1).reshape(0, 12, BONES)
        turning = rotations.part(1, 1, N_JOINTS) - graph.array("identity", np.eye(3))
        return PosedBones(bones, turning.reshape(0, TURNING))


def translated(graph: ValueGraph, bones: Value, trans: Value) -> Value:
    """Bones (B, 12, 23) that end at the translation (B, 3) of the root."""
    turns, shift = bones.split(1, [9, 3])
    return graph.concat([turns, shift + trans.reshape(0, 3, 1)], 1)


def translation(theta: Value) -> Value:
    """(B, 3) metres of theta (B, 69)."""
    return theta.part(1, THETA_SIZE - 3, THETA_SIZE)


def _rotations(graph: ValueGraph, theta: Value) -> Value:
    """(B, 23, 3, 3) by Rodrigues' formula, the last the identity.

    With s = sin(a/2) / (a/2) it is I + sin(a)/a K + s^2/2 K^2, K the cross product by the vector:
    no small numbers are subtracted.
    """
    joints = np.arange(THETA_SIZE) < 3 * N_JOINTS
    vectors = (theta * graph.array("joints", joints)).reshape(0, BONES, 3)
    half = 0.5 * graph.apply("Sqrt", (vectors * vectors).sum(2))  # (B, 23, 1)
    tiny = graph.apply("Less", half, _SMALL_RAD)
    safe = graph.apply("Where", tiny, graph.array("one", 1.0), half)
    sinc = graph.apply("Where", tiny, graph.array("one_more", 1.0), graph.apply("Sin", safe) / safe)
    # sin(a) = 2 sin(a/2) cos(a/2)
    first = (sinc * graph.apply("Cos", half)).reshape(0, BONES, 1, 1)
    second = (0.5 * sinc * sinc).reshape(0, BONES, 1, 1)
    cross = (vectors @ graph.array("cross", _CROSS.reshape(3, 9))).reshape(0, BONES, 3, 3)
    return graph.array("unit", np.eye(3)) + first * cross + second * (cross @ cross)


_CROSS = np.zeros((3, 3, 3))
for _k, _i, _j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_k, _j, _i], _CROSS[_k, _i, _j] = 1.0, -1.0


def _joints(graph: ValueGraph, body: BodyModelData, betas: Value) -> Value:
    """(B, 23, 3, 1) places in the rest pose, metres."""
    by_shape = np.stack([body.J_regressor @ axis for axis in body.shapedirs.transpose(1, 0, 2)], 1)
    kernel, template = np.zeros((BONES, 3, by_shape.shape[2])), np.zeros((BONES, 3))
    kernel[:N_JOINTS], template[:N_JOINTS] = by_shape[:N_JOINTS], body.joints[:N_JOINTS]
    moved = betas @ graph.array("joint_shapes", kernel.reshape(3 * BONES, -1).T)
    return (moved + graph.array("joint_template", template.ravel())).reshape(0, BONES, 3, 1)


def _chained(graph: ValueGraph, own: Value, parents: NDArray) -> Value:
    """(B, 23, 3, 4) each joint's transform after all of its ancestors'.

    Each round doubles how many ancestors a transform holds, so three do for SMPL's eight in a row.
    """
    still = BONES - 1
    ancestor = np.where(parents < 0, still, parents)
    ancestor = np.append(ancestor, still)
    shift_only = graph.array("shift_only", [0.0, 0.0, 0.0, 1.0])
    while (ancestor != still).any():
        above = own.gather(ancestor, axis=1)
        own = above.part(3, 0, 3) @ own + above * shift_only
        ancestor = ancestor[ancestor]
    return own
