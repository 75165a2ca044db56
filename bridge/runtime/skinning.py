"""Posing one body in many frames, in float32: matrix products where the oracle is obvious.

`bridge.body.posing` computes the same in float64, vertex by vertex, and is what this is tested
against. A body's shape does not change within a motion, so it is blended once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import (
    joint_rotations,
    joint_transforms,
    pose_features,
    shaped_joints,
    shaped_vertices,
)


class ShapedBody:
    """A body model with one person's shape.

    Parameters
    ----------
    data : the body model.
    betas : (10,) shape coefficients.

    Raises
    ------
    DsnetError
        If there are other than ten.
    """

    def __init__(self, data: BodyModelData, betas: NDArray) -> None:
        self._data = data
        self._vertices = shaped_vertices(data, betas[None])[0].astype(np.float32)
        self._joints = shaped_joints(data, betas[None])  # (1, 24, 3)
        posedirs = data.posedirs.reshape(-1, data.posedirs.shape[-1])  # (3V, 207)
        self._posedirs = np.ascontiguousarray(posedirs.T, dtype=np.float32)
        self._weights = data.weights.astype(np.float32)

    def pose(self, pose: NDArray, trans: NDArray, offsets: NDArray) -> NDArray[np.float32]:
        """Posed vertices, Eq. 1-2, with `offsets` added in the rest pose.

        Parameters
        ----------
        pose : (T, 22, 3) or (T, 24, 3) axis-angle, radians.
        trans : (T, 3) translation, metres.
        offsets : (T, V, 3) displacement in the rest pose, metres.

        Returns
        -------
        (T, V, 3) vertices, metres.
        """
        rotations = joint_rotations(self._data, pose)
        joints = np.broadcast_to(self._joints, (len(pose), *self._joints.shape[1:]))
        # The bones are few and stay float64; what is done for each vertex is float32.
        bones = joint_transforms(rotations, joints, self._data.parents, trans)[..., :3, :]
        features = pose_features(rotations).astype(np.float32)
        rest = (features @ self._posedirs).reshape(len(pose), -1, 3)
        rest += self._vertices
        rest += offsets
        blended = self._weights @ bones.reshape(len(pose), -1, 12).astype(np.float32)
        T_world_rest = blended.reshape(*rest.shape[:2], 3, 4)
        vertices = np.einsum("tvxy,tvy->tvx", T_world_rest[..., :3], rest)
        vertices += T_world_rest[..., 3]
        return vertices
