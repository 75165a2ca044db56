"""Posing one body in many frames, in float32: matrix products where the oracle is obvious.

`bridge.body.posing` computes the same in float64, vertex by vertex, and is what this is tested
against. A body's shape does not change within a motion, so it is blended once.
"""

from __future__ import annotations

from collections.abc import Sequence

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

_BODIES_AT_ONCE = 64
"""A product for many rows costs each of them less; the others wait, so that memory is bounded."""


class BodySkin:
    """What all persons of a body model share: how vertices follow bones and poses.

    Parameters
    ----------
    data : the body model.
    """

    def __init__(self, data: BodyModelData) -> None:
        self._data = data
        posedirs = data.posedirs.reshape(-1, data.posedirs.shape[-1])  # (3V, 207)
        self._posedirs = np.ascontiguousarray(posedirs.T, dtype=np.float32)
        self._weights = data.weights.astype(np.float32)

    def person(self, betas: NDArray) -> ShapedBody:
        """A person of shape betas (10,)."""
        return ShapedBody(self._data, betas, self)

    def pose(
        self, people: Sequence[ShapedBody], pose: NDArray, trans: NDArray, offsets: NDArray
    ) -> NDArray[np.float32]:
        """Posed vertices (B, V, 3), metres, of B persons, one frame of each.

        Parameters are as those of `ShapedBody.pose`, with B in place of T.
        """
        vertices = np.empty((len(people), *people[0].vertices_m.shape), np.float32)
        for start in range(0, len(people), _BODIES_AT_ONCE):
            part = slice(start, start + _BODIES_AT_ONCE)
            joints = np.concatenate([person.joints_m for person in people[part]])
            rest = offsets[part].astype(np.float32)
            for row, person in zip(rest, people[part], strict=True):
                row += person.vertices_m
            vertices[part] = self.posed(rest, joints, pose[part], trans[part])
        return vertices

    def posed(
        self, rest: NDArray, joints: NDArray, pose: NDArray, trans: NDArray
    ) -> NDArray[np.float32]:
        """Vertices (T, V, 3) of rest vertices without pose blend shapes (T, V, 3), which are
        overwritten, and joints (1 or T, 24, 3), metres."""
        rotations = joint_rotations(self._data, pose)
        joints = np.broadcast_to(joints, (len(pose), *joints.shape[1:]))
        # The bones are few and stay float64; what is done for each vertex is float32.
        bones = joint_transforms(rotations, joints, self._data.parents, trans)[..., :3, :]
        features = pose_features(rotations).astype(np.float32)
        rest += (features @ self._posedirs).reshape(rest.shape)
        blended = self._weights @ bones.reshape(len(pose), -1, 12).astype(np.float32)
        T_world_rest = blended.reshape(*rest.shape[:2], 3, 4)
        vertices = np.einsum("tvxy,tvy->tvx", T_world_rest[..., :3], rest)
        vertices += T_world_rest[..., 3]
        return vertices


class ShapedBody:
    """A body model with one person's shape.

    Parameters
    ----------
    data : the body model.
    betas : (10,) shape coefficients.
    skin : what this person shares with others of that model, if there are any.

    Raises
    ------
    DsnetError
        If there are other than ten.
    """

    def __init__(self, data: BodyModelData, betas: NDArray, skin: BodySkin | None = None) -> None:
        self.vertices_m = shaped_vertices(data, betas[None])[0].astype(np.float32)
        """(V, 3) in the rest pose."""
        self.joints_m = shaped_joints(data, betas[None])
        """(1, 24, 3) in the rest pose."""
        self._skin = skin or BodySkin(data)

    def pose(self, pose: NDArray, trans: NDArray, offsets: NDArray) -> NDArray[np.float32]:
        """Posed vertices, Eq. 1-2, with `offsets` added in the rest pose.

        Parameters
        ----------
        pose : (T, 22, 3) or (T, 24, 3) axis-angle, radians.
        trans : (T, 3) translation, metres.
        offsets : (T, V, 3) displacement in the rest pose, metres; or (1, 1, 3) for all.

        Returns
        -------
        (T, V, 3) vertices, metres.
        """
        rest = np.empty((len(pose), *self.vertices_m.shape), np.float32)
        np.add(offsets, self.vertices_m, out=rest, casting="same_kind")
        return self._skin.posed(rest, self.joints_m, pose, trans)
