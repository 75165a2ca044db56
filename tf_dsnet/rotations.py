"""Rotation matrices of axis-angle vectors, with gradients that stay finite at zero and at pi."""

from __future__ import annotations

from tf_dsnet.framework import Tensor, tf

# Below this squared angle three terms of the series are exact to float64's rounding.
_SERIES_BELOW = 1e-4


def axis_angle_to_matrix(axis_angle: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of axis-angle vectors (..., 3) in radians: Rodrigues' formula.

    The coefficients are smooth functions of the squared angle, so no gradient divides by an
    angle of zero.
    """
    squared = tf.expand_dims(tf.reduce_sum(tf.square(axis_angle), -1, keepdims=True), -1)
    small = squared < _SERIES_BELOW
    angle = tf.sqrt(tf.where(small, tf.ones_like(squared), squared))  # safe to divide by
    sin_over_angle = tf.where(small, 1 - squared / 6 + squared**2 / 120, tf.sin(angle) / angle)
    # By the half angle, because 1 - cos a cancels.
    versine_over_square = tf.where(
        small, 1 / 2 - squared / 24 + squared**2 / 720, 2 * (tf.sin(angle / 2) / angle) ** 2
    )
    cross = _cross_matrix(axis_angle)
    identity = tf.eye(3, dtype=axis_angle.dtype)
    return identity + sin_over_angle * cross + versine_over_square * (cross @ cross)


def _cross_matrix(vector: Tensor) -> Tensor:
    """Matrices (..., 3, 3) whose product with b is the cross product of `vector` (..., 3) and b."""
    x, y, z = tf.unstack(vector, axis=-1)
    zero = tf.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return tf.stack([tf.stack(row, -1) for row in rows], -2)
