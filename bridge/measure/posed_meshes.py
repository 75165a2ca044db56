"""Posed meshes by matrix products: `bridge.body.posing` is the slow oracle of what is here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.posing import (
    joint_rotations,
    joint_transforms,
    pose_features,
    shaped_joints,
    shaped_vertices,
)
from bridge.motion import unpack_theta


@dataclass(frozen=True)
class PosedFrames:
    """SMPL's mesh in some frames, and how it takes offsets along."""

    vertices_m: NDArray[np.float64]
    """(B, V, 3) M(beta, theta), without offsets."""
    linear: NDArray[np.float64]
    """(B, V, 3, 3) linear part of each vertex's skinning transform (Eq. 1)."""

    def carried(self, offsets_m: ArrayLike) -> NDArray[np.float64]:
        """(B, V, 3) what offsets (B or 1, V, 3) of the rest pose add to the posed mesh.

        Skinning is affine: M(beta, theta) + offset is `vertices_m + carried(offset)`.
        """
        offsets_m = np.asarray(offsets_m, dtype=np.float64)
        return np.einsum("bvxy,bvy->bvx", self.linear, np.broadcast_to(offsets_m, self.shape))

    @property
    def shape(self) -> tuple[int, ...]:
        """(B, V, 3)."""
        return self.vertices_m.shape


class PosedBody:
    """One person's body, ready to be posed block by block.

    Parameters
    ----------
    betas : (10,) shape.
    """

    def __init__(self, body: BodyModelData, betas: ArrayLike) -> None:
        betas = np.asarray(betas, dtype=np.float64)[None]
        self._body = body
        self._shaped, self._joints = shaped_vertices(body, betas), shaped_joints(body, betas)

    def pose(self, theta: ArrayLike) -> PosedFrames:
        """The mesh in frames (B, 69) of pose and translation."""
        pose, trans = unpack_theta(np.asarray(theta, dtype=np.float64))
        body, frames = self._body, len(pose)
        rotations = joint_rotations(body, pose)
        bones = joint_transforms(
            rotations, self._joints.repeat(frames, axis=0), body.parents, trans
        )
        blended = body.weights @ bones[..., :3, :].transpose(1, 0, 2, 3).reshape(24, -1)
        blended = blended.reshape(-1, frames, 3, 4).transpose(1, 0, 2, 3)
        by_pose = pose_features(rotations) @ body.posedirs.reshape(-1, body.posedirs.shape[-1]).T
        rest = self._shaped + by_pose.reshape(frames, -1, 3)
        vertices = np.einsum("bvxy,bvy->bvx", blended[..., :3], rest) + blended[..., 3]
        return PosedFrames(vertices, blended[..., :3])
