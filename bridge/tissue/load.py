"""What a moving skeleton and gravity do to the tissue on it, in the frame of the rest pose.

A node of skin at x, turned by R, feels per unit of mass

    inertia  -R^T x''          gravity  R^T g - g

The scanned shape, upright, already hangs in g, so a body that stands as it was scanned feels
nothing. Place and pose enter only through these, which is why what is learned from some motions
holds for others.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations, joint_transforms, pose_features, shaped_joints
from bridge.motion import unpack_theta

GRAVITY_M_S2 = np.array([0.0, -9.81, 0.0])
_FRAMES_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class Load:
    """Accelerations (T, K, 3) of K nodes, m/s^2, in the rest pose's frame."""

    inertia: NDArray[np.float32]
    gravity: NDArray[np.float32]

    def __getitem__(self, frames: slice) -> Load:
        return Load(self.inertia[frames], self.gravity[frames])

    def __len__(self) -> int:
        return len(self.inertia)


class SkinnedNodes:
    """Some vertices of one person's body, skinned as SMPL does (Eq. 1-2).

    Parameters
    ----------
    vertices : (K,) which.
    betas : (10,) shape.
    """

    def __init__(self, body: BodyModelData, vertices: NDArray, betas: NDArray) -> None:
        self._body, self._vertices = body, vertices
        self._posedirs = body.posedirs[vertices]
        self._weights = body.weights[vertices]
        self._take(betas)

    def _take(self, betas: NDArray) -> None:
        betas, vertices = np.asarray(betas, np.float64), self._vertices
        self._joints = shaped_joints(self._body, betas[None])
        self._rest = self._body.v_template[vertices] + self._body.shapedirs[vertices] @ betas

    def of_person(self, betas: NDArray) -> SkinnedNodes:
        """The same vertices of another person (10,); what all persons share is stored once."""
        other = copy(self)
        other._take(betas)
        return other

    def __call__(self, theta: NDArray) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Places (T, K, 3), metres, and skinning rotations (T, K, 3, 3) of a motion (T, 69)."""
        parts = [
            self.skin(theta[start : start + _FRAMES_AT_ONCE])
            for start in range(0, len(theta), _FRAMES_AT_ONCE)
        ]
        places, turns = zip(*parts, strict=True)
        return np.concatenate(places), np.concatenate(turns)

    @classmethod
    def of_people(cls, people: Sequence[SkinnedNodes]) -> SkinnedNodes:
        """The same vertices of B persons, for `skin` alone, whose rows are then theirs."""
        several = copy(people[0])
        several._joints = np.concatenate([person._joints for person in people])
        several._rest = np.stack([person._rest for person in people])
        return several

    def skin(self, theta: NDArray) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """The same, all at once."""
        pose, trans = unpack_theta(np.asarray(theta, np.float64))
        rotations = joint_rotations(self._body, pose)
        joints = np.broadcast_to(self._joints, (len(theta), *self._joints.shape[1:]))
        bones = joint_transforms(rotations, joints, self._body.parents, trans)
        # Weights sum to 1 only up to rounding; blended this way, standing is no turn exactly.
        flat = (bones[:, :, :3] - np.eye(3, 4)).reshape(len(theta), len(joints[0]), 12)
        blended = (self._weights @ flat).reshape(len(theta), -1, 3, 4) + np.eye(3, 4)
        corrected = self._rest + np.tensordot(pose_features(rotations), self._posedirs, (1, 2))
        turned = np.einsum("tkxy,tky->tkx", blended[..., :3], corrected)
        return turned + blended[..., 3], blended[..., :3]


def node_loads(
    body: BodyModelData, vertices: NDArray, betas: NDArray, theta: NDArray, fps: float
) -> Load:
    """The loads of a motion theta (T, 69) on nodes at `vertices` (K,) of a body (10,).

    Accelerations are central differences; the first and last frame, which have none, stand still.
    """
    places, turns = SkinnedNodes(body, vertices, betas)(theta)
    acceleration = np.zeros_like(places)
    acceleration[1:-1] = (places[2:] - 2 * places[1:-1] + places[:-2]) * fps**2
    return in_rest_frame(acceleration, turns)


def in_rest_frame(acceleration: NDArray, turns: NDArray) -> Load:
    """The loads of nodes that accelerate (T, K, 3), m/s^2, and are turned by (T, K, 3, 3)."""
    # R^T w is w^T R: no transposed copies.
    inertia = -np.einsum("tkx,tkxy->tky", acceleration, turns)
    gravity = np.einsum("x,tkxy->tky", GRAVITY_M_S2, turns) - GRAVITY_M_S2
    return Load(inertia.astype(np.float32), gravity.astype(np.float32))
