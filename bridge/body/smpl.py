"""Posing by matrix products, in float32 or float64, of all vertices or of some (Eq. 1-2).

`bridge.body.posing` computes the same vertex by vertex and is what this is tested against. A body's
shape does not change within a motion, so it is blended once. Within a frame each component's
numbers lie side by side: NumPy's loops then run along vertices and not along three coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import BodyModelData
from bridge.body.posing import (
    joint_rotations,
    joint_transforms,
    pose_features,
    shaped_joints,
    shaped_vertices,
)

_FRAMES_AT_ONCE = 64
"""A product for many rows costs each of them less; the others wait, so that memory is bounded."""


class Smpl:
    """What all persons of a body model share: how vertices follow bones and poses.

    Parameters
    ----------
    data : the body model.
    vertices : (K,) which; all when None.
    dtype : of what is done for each vertex; the bones are few and stay float64.
    """

    def __init__(
        self,
        data: BodyModelData,
        vertices: NDArray[np.integer] | None = None,
        dtype: type[np.floating] = np.float32,
    ) -> None:
        self.data, self.dtype = data, dtype
        self.vertices = np.arange(data.vertex_count) if vertices is None else vertices
        by_pose = data.posedirs[self.vertices].transpose(2, 1, 0)  # (207, 3, K)
        self._posedirs = np.ascontiguousarray(by_pose, self.dtype).reshape(len(by_pose), -1)
        self._weights = np.ascontiguousarray(data.weights[self.vertices].T, self.dtype)

    def person(self, betas: NDArray) -> ShapedBody:
        """A person of shape betas (10,).

        Raises
        ------
        DsnetError
            If there are other than ten.
        """
        shape = np.asarray(betas, np.float64)[None]
        rest_m = shaped_vertices(self.data, shape)[0, self.vertices].T
        return ShapedBody(
            self, np.ascontiguousarray(rest_m, self.dtype), shaped_joints(self.data, shape)
        )

    def pose(
        self,
        people: Sequence[ShapedBody],
        pose: NDArray,
        trans: NDArray,
        offsets: NDArray | None = None,
    ) -> NDArray[np.floating]:
        """Posed vertices (T, K, 3), metres, of one person in T frames or of T in one frame each.

        Parameters
        ----------
        pose : (T, 22, 3) or (T, 24, 3) axis-angle, radians.
        trans : (T, 3) translation, metres.
        offsets : (T, K, 3) displacement in the rest pose, metres; none when None.
        """
        vertices = np.empty((len(pose), len(self.vertices), 3), self.dtype)
        for frame, (rest, blended) in enumerate(self._frames(people, pose, trans, offsets)):
            vertices[frame] = _moved(rest, blended).T
        return vertices

    def skin(
        self, people: Sequence[ShapedBody], pose: NDArray, trans: NDArray
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Places (T, K, 3), metres, and what turns each vertex (T, K, 3, 3): the linear part of
        its skinning transform. Parameters are as in `pose`."""
        count = len(self.vertices)
        places = np.empty((len(pose), 3, count), self.dtype)
        turns = np.empty((len(pose), 3, 3, count), self.dtype)
        for frame, (rest, blended) in enumerate(self._frames(people, pose, trans, None)):
            places[frame], turns[frame] = _moved(rest, blended), blended[:, :3]
        return places.transpose(0, 2, 1), turns.transpose(0, 3, 1, 2)

    def _frames(
        self, people: Sequence[ShapedBody], pose: NDArray, trans: NDArray, offsets: NDArray | None
    ) -> Iterator[tuple[NDArray, NDArray]]:
        """Of each frame the rest pose (3, K) and each vertex's transform (3, 4, K)."""
        for start in range(0, len(pose), _FRAMES_AT_ONCE):
            part = slice(start, start + _FRAMES_AT_ONCE)
            some = people[part] if len(people) > 1 else people
            rotations = joint_rotations(self.data, pose[part])
            joints = np.concatenate([person.joints_m for person in some])
            joints = np.broadcast_to(joints, (len(rotations), *joints.shape[1:]))
            bones = joint_transforms(rotations, joints, self.data.parents, trans[part])
            # Weights sum to 1 only up to rounding; blended this way, standing is no turn exactly.
            moved = (bones[:, :, :3] - np.eye(3, 4)).transpose(0, 2, 3, 1).astype(self.dtype)
            moved = moved.reshape(len(moved), 12, -1)
            features = pose_features(rotations).astype(self.dtype)
            rest = (features @ self._posedirs).reshape(len(features), 3, -1)
            for row, bone in enumerate(moved):
                rest[row] += some[row % len(some)].rest_m
                if offsets is not None:
                    rest[row] += offsets[start + row].T
                blended = (bone @ self._weights).reshape(3, 4, -1)
                for axis in range(3):
                    blended[axis, axis] += 1
                yield rest[row], blended


def _moved(rest: NDArray, blended: NDArray) -> NDArray:
    """(3, K) the vertices of a rest pose (3, K), by their transforms (3, 4, K)."""
    placed = np.einsum("xyk,yk->xk", blended[:, :3], rest)
    placed += blended[:, 3]
    return placed


@dataclass(frozen=True, eq=False)
class ShapedBody:
    """One person's shape."""

    smpl: Smpl
    rest_m: NDArray[np.floating]
    """(3, K) vertices in the rest pose."""
    joints_m: NDArray[np.float64]
    """(1, 24, 3) in the rest pose."""

    def pose(
        self, pose: NDArray, trans: NDArray, offsets: NDArray | None = None
    ) -> NDArray[np.floating]:
        """Posed vertices (T, K, 3) of T frames; see `Smpl.pose`."""
        return self.smpl.pose([self], pose, trans, offsets)

    def skin(self, pose: NDArray, trans: NDArray) -> tuple[NDArray, NDArray]:
        """Places and turns of T frames; see `Smpl.skin`."""
        return self.smpl.skin([self], pose, trans)
