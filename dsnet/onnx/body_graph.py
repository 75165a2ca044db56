"""Posing a body inside an ONNX graph: Eq. 1-2, which `bridge.body.posing` computes in NumPy.

Bones have coordinates first, joints and characters last, (3, 4, 23, B), so that all small matrices
are multiplied in a few operations on long rows. Vertices are the last axis, (B, 3, V), so that each
step is one matrix product or an elementwise one. theta has no hands: they stay in their rest pose
relative to the wrists, so their skinning weights are added to the wrists'.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import N_JOINTS, THETA_SIZE
from dsnet.onnx.onnx_graph import Graph, Value
from dsnet.onnx.precision import Precision, product

BONES = N_JOINTS + 1
"""The joints of theta, and one that never moves, as the root's parent."""
POSE_FEATURES = 9 * (N_JOINTS - 1)
"""How many: R - I of the joints of theta without the root."""
_SMALL_RAD = 1e-4
"""Half angle below which its sine equals it in float32."""
_CROSS_AXES = np.array([[0, 2, 1], [2, 1, 0], [1, 0, 2]])
_CROSS_SIGNS = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])[..., None, None]
_UNIT = np.eye(3)[..., None, None]


def posed_bones(
    graph: Graph, body: BodyModelData, theta: Value, betas: Value
) -> tuple[Value, Value]:
    """Bones (B, 12, 23) and pose features R - I (B, 189) of theta (B, 69) and betas (B, S).

    The 12 numbers are the columns of [R | t], from the rest pose to the posed body, without the
    translation of theta.
    """
    with graph.section("bones"):
        rotations = _rotations(graph, theta)  # (3, 3, 23, B)
        joints = _joints(graph, body, betas)  # (3, 1, 23, B)
        local = graph.concat(
            [rotations, joints - _product(rotations, joints)], 1
        )  # about the joint
        world = _chained(graph, local, body.parents[:N_JOINTS])
        bones = world.transpose(3, 1, 0, 2).reshape(0, 12, BONES)
        features = rotations.part(2, 1, N_JOINTS) - graph.array("identity", _UNIT)
        return bones, features.transpose(3, 2, 0, 1).reshape(0, POSE_FEATURES)


def translated(graph: Graph, bones: Value, trans: Value) -> Value:
    """Bones (B, 12, 23) with the translation (B, 3) of the root added."""
    rotations, shift = bones.split(1, [9, 3])
    return graph.concat([rotations, shift + trans.reshape(0, 3, 1)], 1)


def translation(theta: Value) -> Value:
    """The translation (B, 3), metres, of theta (B, 69)."""
    return theta.part(1, THETA_SIZE - 3, THETA_SIZE)


def _rotations(graph: Graph, theta: Value) -> Value:
    """Rotations (3, 3, 23, B) by Rodrigues' formula; the last one is the identity.

    With s = sin(a/2) / (a/2) it is (1 - s^2/2 a^2) I + sin(a)/a K + s^2/2 v v^T, K the cross
    product by the vector v of the angle a. No small number is a difference of large ones.
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
    cross = (first * vectors).gather(_CROSS_AXES, axis=0) * graph.array("signs", _CROSS_SIGNS)
    outer = (second * vectors).reshape(3, 1, BONES, -1) * vectors.reshape(1, 3, BONES, -1)
    return graph.array("unit", _UNIT) * (1.0 + -(second * squared)) + cross + outer


def _joints(graph: Graph, body: BodyModelData, betas: Value) -> Value:
    """Joints (3, 1, 23, B) in the rest pose, metres."""
    kernel, template = np.zeros((3, BONES, body.shapedirs.shape[2])), np.zeros((3, BONES))
    kernel[:, :N_JOINTS] = body.joint_shapes[:N_JOINTS].transpose(1, 0, 2)
    template[:, :N_JOINTS] = body.joints[:N_JOINTS].T
    by_shape = betas @ graph.array("joint_shapes", kernel.reshape(3 * BONES, -1).T)
    joints = by_shape + graph.array("joint_template", template.ravel())
    return joints.transpose(1, 0).reshape(3, 1, BONES, -1)


def _chained(graph: Graph, local: Value, parents: NDArray) -> Value:
    """World transforms (3, 4, 23, B): each joint's times those of all of its ancestors.

    Each round doubles how many ancestors a transform includes, so three rounds are enough for
    SMPL's chains of eight joints.
    """
    fixed = BONES - 1
    ancestor = np.append(np.where(parents < 0, fixed, parents), fixed)
    shift_only = graph.array("shift_only", np.reshape([0.0, 0.0, 0.0, 1.0], (1, 4, 1, 1)))
    while (ancestor != fixed).any():
        rotations, shift = local.gather(ancestor, axis=2).split(1, [3, 1])
        local = _product(rotations, local) + shift * shift_only
        ancestor = ancestor[ancestor]
    return local


def _product(left: Value, right: Value) -> Value:
    """Matrices (3, 3, 23, B) times matrices (3, N, 23, B), one by one."""
    columns, rows = left.split(1, [1, 1, 1]), right.split(0, [1, 1, 1])
    return columns[0] * rows[0] + columns[1] * rows[1] + columns[2] * rows[2]


class Surface:
    """K vertices of a body, in the rest pose and skinned."""

    def __init__(
        self,
        graph: Graph,
        body: BodyModelData,
        vertices: slice | NDArray,
        precision: Precision = "float32",
    ) -> None:
        by_pose = body.posedirs[vertices].transpose(2, 1, 0)[:POSE_FEATURES]  # (189, 3, K)
        shapes = body.shapedirs[vertices].transpose(2, 1, 0)
        self._graph, self._count = graph, by_pose.shape[-1]
        self._by_pose = product(graph, "posedirs", by_pose.reshape(POSE_FEATURES, -1), precision)
        self._shapes = graph.array("shapedirs", shapes.reshape(len(shapes), -1))
        self._template = graph.array("template", body.v_template[vertices].T.ravel())
        self._bone_weights = bone_weights(body)[vertices].T

    @cached_property
    def weights(self) -> Value:
        """Skinning weights (23, K)."""
        return self._graph.array("weights", self._bone_weights)

    def rest(self, features: Value, betas: Value) -> Value:
        """Rest pose (B, 3, K), metres, of pose features R - I (B, 189) and betas (B, S)."""
        displaced = self._by_pose(features) + betas @ self._shapes
        return (displaced + self._template).reshape(0, 3, -1)

    def skinned(self, bones: Value, rest: Value) -> Value:
        """Skinned vertices (B, K, 3) of a rest pose (B, 3, K) by bones (B, 12, 23)."""

        def skin_group(bones: Value, rest: Value) -> Value:
            *columns, shift = (part @ self.weights for part in bones.split(1, [3, 3, 3, 3]))
            return turned(columns, shift, rest)

        grouped = self._graph.in_groups([bones, rest], skin_group, (3, self._count))
        return grouped.transpose(0, 2, 1)


def turned(columns: list[Value], shift: Value, rest: Value) -> Value:
    """R x + t of points x (B, 3, V); `columns` are those of R, `shift` is t."""
    for column, coordinate in zip(columns, rest.split(1, [1, 1, 1]), strict=True):
        shift = shift + column * coordinate
    return shift


def bone_weights(body: BodyModelData) -> NDArray[np.float64]:
    """Skinning weights (V, 23) of the joints of theta, and zeros for the fixed one."""
    return np.pad(body.body_weights, ((0, 0), (0, 1)))
