"""SMPL in TensorFlow: Eq. 1-2, differentiable in every argument, and its inverse, Eq. 5.

`torch_align_ae/body` has the same in PyTorch. Inside, coordinates come before vertices, (B, 3, V),
so that skinning streams over vertices.
"""

from __future__ import annotations

import numpy as np

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from tf_dsnet.framework import Tensor, tf

# Below this squared angle three terms of the series are exact to float64's rounding.
_SERIES_BELOW = 1e-4
# A half-and-half blend of rotations phi apart shrinks two directions by cos(phi / 2): below this
# (phi above 176 degrees) the inverse would blow up a millimetre to three centimetres.
_COLLAPSED_BELOW = 1e-3**0.5


class KerasSMPL:
    """A body model with constant parameters and V = 6890 vertices.

    It computes in `dtype`, to which arguments are converted.
    """

    def __init__(self, data: BodyModelData, dtype: tf.DType = tf.float32) -> None:
        self.data, self.dtype = data, dtype
        self.vertex_count = len(data.v_template)
        self.parents: tuple[int, ...] = tuple(data.parents.tolist())
        self._template = tf.constant(data.v_template.T, dtype)  # (3, V)
        self._shapedirs = _rows(data.shapedirs, dtype)  # (10, 3 V)
        self._posedirs = _rows(data.posedirs, dtype)  # (207, 3 V)
        self._weights = tf.constant(data.weights.T, dtype)  # (24, V)
        self._joint_template = tf.constant(data.joints, dtype)  # (24, 3)
        self._joint_shapedirs = tf.constant(data.joint_shapes.transpose(2, 0, 1), dtype)

    def __call__(
        self, betas: Tensor, pose: Tensor, trans: Tensor, offsets: Tensor | None = None
    ) -> Tensor:
        """Posed vertices (B, V, 3), metres, Eq. 1-2.

        Parameters
        ----------
        betas : (B, 10) shape.
        pose : (B, 22, 3) or (B, 24, 3) axis-angle, radians; missing hand joints stay at rest.
        trans : (B, 3) translation, metres.
        offsets : (B, V, 3) displacement added in the rest pose, metres, or None.
        """
        rotations = self.rotations(pose)
        rest = self.planar_rest(betas, rotations)
        if offsets is not None:
            added = self.checked("offsets", offsets, (len(betas), self.vertex_count, 3))
            rest += tf.transpose(added, (0, 2, 1))
        blended = self.blended_transforms(betas, rotations, trans)
        posed = tf.reduce_sum(blended[:, :, :3] * rest[:, None], 2) + blended[:, :, 3]
        return tf.transpose(posed, (0, 2, 1))

    def rest_vertices(self, betas: Tensor, pose: Tensor) -> Tensor:
        """(B, V, 3) shaped body with pose blend shapes, before skinning (Eq. 2), metres."""
        return tf.transpose(self.planar_rest(betas, self.rotations(pose)), (0, 2, 1))

    def joints(self, betas: Tensor) -> Tensor:
        """(B, 24, 3) joints of the shaped body in the rest pose, metres."""
        betas = self.checked("betas", betas, (len(betas), len(self._shapedirs)))
        return self._joint_template + tf.tensordot(betas, self._joint_shapedirs, 1)

    def rotations(self, pose: Tensor) -> Tensor:
        """(B, 24, 3, 3) rotation of each joint from (B, 22, 3) or (B, 24, 3) axis-angle."""
        joint_count = 24 if np.shape(pose)[1:] == (24, 3) else 22
        pose = self.checked("pose", pose, (len(pose), joint_count, 3))
        missing = len(self.parents) - joint_count
        return axis_angle_to_matrix(tf.pad(pose, ((0, 0), (0, missing), (0, 0))))

    def planar_rest(self, betas: Tensor, rotations: Tensor) -> Tensor:
        """Eq. 2 as (B, 3, V)."""
        betas = self.checked("betas", betas, (len(betas), len(self._shapedirs)))
        features = rotations[:, 1:] - tf.eye(3, dtype=self.dtype)
        features = tf.reshape(features, (-1, len(self._posedirs)))
        moved = betas @ self._shapedirs + features @ self._posedirs
        return self._template + tf.reshape(moved, (-1, 3, self.vertex_count))

    def blended_transforms(self, betas: Tensor, rotations: Tensor, trans: Tensor) -> Tensor:
        """Each vertex's weighted mean of the bones' transforms, (B, 3, 4, V), rest to world."""
        trans, joints = self.checked("trans", trans, (len(betas), 3)), self.joints(betas)
        # `T_world_rest` of each bone, down the tree from the root.
        turns, places = [rotations[:, 0]], [joints[:, 0] + trans]
        for joint, parent in enumerate(self.parents[1:], start=1):
            bone = joints[:, joint] - joints[:, parent]
            turns.append(turns[parent] @ rotations[:, joint])
            places.append(places[parent] + tf.linalg.matvec(turns[parent], bone))
        turn, place = tf.stack(turns, 1), tf.stack(places, 1)
        moved = (place - tf.linalg.matvec(turn, joints))[..., None]
        bones = tf.concat([turn, moved], -1)  # (B, 24, 3, 4)
        planar = tf.reshape(tf.transpose(bones, (0, 2, 3, 1)), (-1, len(self.parents)))
        return tf.reshape(planar @ self._weights, (-1, 3, 4, self.vertex_count))

    def checked(self, name: str, value: Tensor, shape: tuple[int, ...]) -> Tensor:
        """`value` in the body's precision, or DsnetError if it has another shape."""
        if tuple(np.shape(value)) != shape:
            raise DsnetError(
                f"{name} of shape {tuple(np.shape(value))}",
                f"shape {shape}",
                "Give one row per body; axis-angle vectors, not the flat theta of 69 numbers.",
            )
        return tf.cast(value, self.dtype)


def _rows(directions: np.ndarray, dtype: tf.DType) -> Tensor:
    """(V, 3, N) blend shapes as (N, 3 V)."""
    return tf.constant(directions.transpose(2, 1, 0).reshape(directions.shape[2], -1), dtype)


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
    x, y, z = tf.unstack(axis_angle, axis=-1)
    zero = tf.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    cross = tf.stack([tf.stack(row, -1) for row in rows], -2)
    identity = tf.eye(3, dtype=axis_angle.dtype)
    return identity + sin_over_angle * cross + versine_over_square * (cross @ cross)


def unpose(smpl: KerasSMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor) -> Tensor:
    """Rest-pose vertices (B, V, 3) of a posed mesh (B, V, 3), metres: W^-1 of Eq. 5.

    Each vertex's blended transform is inverted; the pose blend shapes stay in the result. Where
    skinning has collapsed a vertex (bones turned half round against each other), the collapsed
    directions cannot be seen in the posed mesh; there the result keeps the body model's own
    rest-pose vertex, so its offset is zero in these directions.
    """
    vertices = smpl.checked("vertices", vertices, (len(betas), smpl.vertex_count, 3))
    rotations = smpl.rotations(pose)
    blended = tf.transpose(smpl.blended_transforms(betas, rotations, trans), (0, 3, 1, 2))
    matrix, moved = tf.split(blended, (3, 1), axis=-1)  # (B, V, 3, 3), (B, V, 3, 1)
    rest = tf.transpose(smpl.planar_rest(betas, rotations), (0, 2, 1))
    residual = vertices - tf.squeeze(moved, -1) - tf.linalg.matvec(matrix, rest)
    return rest + tf.linalg.matvec(tf.linalg.pinv(matrix, rcond=_COLLAPSED_BELOW), residual)
