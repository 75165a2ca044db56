"""Posing a body inside an ONNX graph: Eq. 1-2, which `bridge.body.posing` computes in NumPy.

Bones have coordinates first, joints and characters last, (3, 4, 23, B): then all small matrices are
multiplied in a few operations on long rows. Vertices are the last axis, (B, 3, V), so that each
step is one matrix product or a row of multiplications. theta has no hands: they stay at rest, where
their bones move with the wrists', so their weights are the wrists'.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import N_JOINTS, THETA_SIZE
from dsnet.onnx.onnx_graph import Graph, Precision, Value, product

BONES = N_JOINTS + 1
"""The joints of theta, and one that never moves: the root's parent."""
TURNING = 9 * (N_JOINTS - 1)
"""Pose features, R - I, of the joints that theta has but for the root."""
_SMALL_RAD = 1e-4
"""Half an angle below which its sine is itself in float32."""
_OTHER_AXIS = np.array([[0, 2, 1], [2, 1, 0], [1, 0, 2]])
_SIGNS = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])[..., None, None]
_UNIT = np.eye(3)[..., None, None]


def posed_bones(
    graph: Graph, body: BodyModelData, theta: Value, betas: Value
) -> tuple[Value, Value]:
    """Of theta (B, 69) and betas (B, S), without their place in the world: bones (B, 12, 23) from
    the rest pose, whose rows are the columns of [R | t] one after another, and R - I (B, 189)."""
    with graph.section("bones"):
        rotations = _rotations(graph, theta)  # (3, 3, 23, B)
        joints = _joints(graph, body, betas)  # (3, 1, 23, B)
        own = graph.concat([rotations, joints - _product(rotations, joints)], 1)  # about the joint
        chained = _chained(graph, own, body.parents[:N_JOINTS])
        bones = chained.transpose(3, 1, 0, 2).reshape(0, 12, BONES)
        turning = rotations.part(2, 1, N_JOINTS) - graph.array("identity", _UNIT)
        return bones, turning.transpose(3, 2, 0, 1).reshape(0, TURNING)


def translated(graph: Graph, bones: Value, trans: Value) -> Value:
    """Bones (B, 12, 23) that end at the translation (B, 3) of the root."""
    turns, shift = bones.split(1, [9, 3])
    return graph.concat([turns, shift + trans.reshape(0, 3, 1)], 1)


def translation(theta: Value) -> Value:
    """(B, 3) metres of theta (B, 69)."""
    return theta.part(1, THETA_SIZE - 3, THETA_SIZE)


def _rotations(graph: Graph, theta: Value) -> Value:
    """(3, 3, 23, B) by Rodrigues' formula, the last the identity.

    With s = sin(a/2) / (a/2) it is (1 - s^2/2 a^2) I + sin(a)/a K + s^2/2 v v^T, K the cross
    product by the vector v of the angle a: what is small is no difference of what is not.
    """
    joints = np.arange(THETA_SIZE) < 3 * N_JOINTS
    by_axis = np.arange(THETA_SIZE).reshape(BONES, 3).T
    vectors = (theta * graph.array("joints", joints)).transpose(1, 0).gather(by_axis, axis=0)
    squared = (vectors * vectors).sum(0)  # (1, 23, B)
    half = 0.5 * graph.apply("Sqrt", squared)
    tiny = graph.apply("Less", half, _SMALL_RAD)
    safe = graph.apply("Where", tiny, 1.0, half)
    sinc = graph.apply("Where", tiny, 1.0, graph.apply("Sin", safe) / safe)
    # sin(a) = 2 sin(a/2) cos(a/2)
    first, second = sinc * graph.apply("Cos", half), 0.5 * sinc * sinc
    cross = (first * vectors).gather(_OTHER_AXIS, axis=0) * graph.array("signs", _SIGNS)
    outer = (second * vectors).reshape(3, 1, BONES, -1) * vectors.reshape(1, 3, BONES, -1)
    return graph.array("unit", _UNIT) * (1.0 + -(second * squared)) + cross + outer


def _joints(graph: Graph, body: BodyModelData, betas: Value) -> Value:
    """(3, 1, 23, B) places in the rest pose, metres."""
    kernel, template = np.zeros((3, BONES, body.shapedirs.shape[2])), np.zeros((3, BONES))
    kernel[:, :N_JOINTS] = body.joint_shapes[:N_JOINTS].transpose(1, 0, 2)
    template[:, :N_JOINTS] = body.joints[:N_JOINTS].T
    moved = betas @ graph.array("joint_shapes", kernel.reshape(3 * BONES, -1).T)
    placed = moved + graph.array("joint_template", template.ravel())
    return placed.transpose(1, 0).reshape(3, 1, BONES, -1)


def _chained(graph: Graph, own: Value, parents: NDArray) -> Value:
    """(3, 4, 23, B) each joint's transform after all of its ancestors'.

    Each round doubles how many ancestors a transform holds, so three do for SMPL's eight in a row.
    """
    still = BONES - 1
    ancestor = np.append(np.where(parents < 0, still, parents), still)
    shift_only = graph.array("shift_only", np.reshape([0.0, 0.0, 0.0, 1.0], (1, 4, 1, 1)))
    while (ancestor != still).any():
        turns, shift = own.gather(ancestor, axis=2).split(1, [3, 1])
        own = _product(turns, own) + shift * shift_only
        ancestor = ancestor[ancestor]
    return own


def _product(left: Value, right: Value) -> Value:
    """Matrices (3, 3, 23, B) times others (3, N, 23, B), each by each."""
    columns, rows = left.split(1, [1, 1, 1]), right.split(0, [1, 1, 1])
    return columns[0] * rows[0] + columns[1] * rows[1] + columns[2] * rows[2]


class Surface:
    """Some vertices of a body, K."""

    def __init__(
        self,
        graph: Graph,
        body: BodyModelData,
        vertices: slice | NDArray,
        precision: Precision = "float32",
    ) -> None:
        by_pose = body.posedirs[vertices].transpose(2, 1, 0)[:TURNING]  # (189, 3, K)
        shapes = body.shapedirs[vertices].transpose(2, 1, 0)
        self._graph, self._count = graph, by_pose.shape[-1]
        self._posing = product(graph, "posedirs", by_pose.reshape(TURNING, -1), precision)
        self._shapes = graph.array("shapedirs", shapes.reshape(len(shapes), -1))
        self._template = graph.array("template", body.v_template[vertices].T.ravel())
        self._bone_weights = bone_weights(body)[vertices].T

    @cached_property
    def weights(self) -> Value:
        """(23, K) of the bones."""
        return self._graph.array("weights", self._bone_weights)

    def rest(self, turning: Value, betas: Value) -> Value:
        """(B, 3, K) the rest pose, metres, of R - I (B, 189) and betas (B, S)."""
        moved = self._posing(turning) + betas @ self._shapes
        return (moved + self._template).reshape(0, 3, -1)

    def skinned(self, bones: Value, rest: Value) -> Value:
        """(B, K, 3) a rest pose (B, 3, K), turned and moved by bones (B, 12, 23)."""

        def few(bones: Value, rest: Value) -> Value:
            *columns, shift = (part @ self.weights for part in bones.split(1, [3, 3, 3, 3]))
            return turned(columns, shift, rest)

        grouped = self._graph.in_groups([bones, rest], few, (3, self._count))
        return grouped.transpose(0, 2, 1)


def turned(columns: list[Value], shift: Value, rest: Value) -> Value:
    """R x + t of places (B, 3, V), where `columns` are those of R."""
    for column, coordinate in zip(columns, rest.split(1, [1, 1, 1]), strict=True):
        shift = shift + column * coordinate
    return shift


def bone_weights(body: BodyModelData) -> NDArray[np.float64]:
    """(V, 23) skinning weights of the joints that theta has, and zeros for the one at rest."""
    return np.pad(body.body_weights, ((0, 0), (0, 1)))
