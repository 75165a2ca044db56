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
        return np.einsum("bvxy,bvy->bvx", self.linear, by_component(offsets_m))


def by_component(vectors: ArrayLike) -> NDArray[np.float64]:
    """(B, V, 3) in float64, each component's values side by side in memory.

    NumPy's loops then run along vertices instead of along three coordinates: ten times faster.
    """
    components = np.moveaxis(np.asarray(vectors), -1, 0).astype(np.float64, order="C")
    return np.moveaxis(components, 0, -1)


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
        joints = self._joints.repeat(frames, axis=0)
        bones = joint_transforms(rotations, joints, body.parents, trans)[..., :3, :]
        # Products whose rows are components and frames: the layout that `by_component` explains.
        blended = bones.transpose(2, 3, 0, 1).reshape(12 * frames, -1) @ body.weights.T
        blended = blended.reshape(3, 4, frames, -1).transpose(2, 3, 0, 1)
        features = pose_features(rotations)
        by_pose = np.stack([features @ body.posedirs[:, axis].T for axis in range(3)])
        rest = self._shaped + np.moveaxis(by_pose, 0, -1)
        vertices = np.einsum("bvxy,bvy->bvx", blended[..., :3], rest) + blended[..., 3]
        return PosedFrames(vertices, blended[..., :3])
