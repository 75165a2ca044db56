"""A pose as bones in an ONNX graph: rotations, joints, and each bone after all of its ancestors.

Coordinates come first, joints and characters last, (3, 4, 23, B): then all small matrices are
multiplied in a few operations on long rows, and not one after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import N_JOINTS, THETA_SIZE
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


def posed_bones(graph: ValueGraph, body: BodyModelData, theta: Value, betas: Value) -> PosedBones:
    """Bones and pose features of theta (B, 69) and betas (B, 10)."""
    with graph.section("bones"):
        rotations = _rotations(graph, theta)  # (3, 3, 23, B)
        joints = _joints(graph, body, betas)  # (3, 1, 23, B)
        own = graph.concat([rotations, joints - _product(rotations, joints)], 1)  # about the joint
        chained = _chained(graph, own, body.parents[:N_JOINTS])
        bones = chained.transpose(3, 1, 0, 2).reshape(0, 12, BONES)
        turning = rotations.part(2, 1, N_JOINTS) - graph.array("identity", _planar(np.eye(3)))
        return PosedBones(bones, turning.transpose(3, 2, 0, 1).reshape(0, TURNING))


def translated(graph: ValueGraph, bones: Value, trans: Value) -> Value:
    """Bones (B, 12, 23) that end at the translation (B, 3) of the root."""
    turns, shift = bones.split(1, [9, 3])
    return graph.concat([turns, shift + trans.reshape(0, 3, 1)], 1)


def translation(theta: Value) -> Value:
    """(B, 3) metres of theta (B, 69)."""
    return theta.part(1, THETA_SIZE - 3, THETA_SIZE)


def _rotations(graph: ValueGraph, theta: Value) -> Value:
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
    safe = graph.apply("Where", tiny, graph.array("one", 1.0), half)
    sinc = graph.apply("Where", tiny, graph.array("one_more", 1.0), graph.apply("Sin", safe) / safe)
    # sin(a) = 2 sin(a/2) cos(a/2)
    first, second = sinc * graph.apply("Cos", half), 0.5 * sinc * sinc
    cross = (first * vectors).gather(_OTHER_AXIS, axis=0) * graph.array("signs", _planar(_SIGNS))
    outer = (second * vectors).reshape(3, 1, BONES, -1) * vectors.reshape(1, 3, BONES, -1)
    return graph.array("unit", _planar(np.eye(3))) * (1.0 + -(second * squared)) + cross + outer


_OTHER_AXIS = np.array([[0, 2, 1], [2, 1, 0], [1, 0, 2]])
_SIGNS = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])


def _joints(graph: ValueGraph, body: BodyModelData, betas: Value) -> Value:
    """(3, 1, 23, B) places in the rest pose, metres."""
    by_shape = np.stack([body.J_regressor @ axis for axis in body.shapedirs.transpose(1, 0, 2)])
    kernel, template = np.zeros((3, BONES, by_shape.shape[2])), np.zeros((3, BONES))
    kernel[:, :N_JOINTS], template[:, :N_JOINTS] = by_shape[:, :N_JOINTS], body.joints[:N_JOINTS].T
    moved = betas @ graph.array("joint_shapes", kernel.reshape(3 * BONES, -1).T)
    placed = moved + graph.array("joint_template", template.ravel())
    return placed.transpose(1, 0).reshape(3, 1, BONES, -1)


def _chained(graph: ValueGraph, own: Value, parents: NDArray) -> Value:
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
    first, *others = (column * row for column, row in zip(columns, rows, strict=True))
    for other in others:
        first = first + other
    return first


def _planar(matrix: NDArray) -> NDArray:
    """(3, 3) as one that all joints of all characters share."""
    return matrix[..., None, None]
