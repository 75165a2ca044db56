"""How offsets that are wrong in the rest pose show in the posed mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData
from bridge.body.posing import joint_transforms, shaped_joints

_JOINTS = 24


def blended_rotations(
    body: BodyModelData, betas: ArrayLike, pose: ArrayLike
) -> NDArray[np.float64]:
    """Linear part of each vertex's skinning transform (Eq. 1).

    Skinning is affine, so an offset's error e in the rest pose is, in the posed mesh, this matrix
    times e: the mesh S_t needs not be posed to know the error against it.

    Parameters
    ----------
    betas : (10,) shape.
    pose : (B, 22, 3) axis-angle.

    Returns
    -------
    (B, V, 3, 3)
    """
    pose = np.asarray(pose, dtype=np.float64)
    rotvec = np.zeros((len(pose), _JOINTS, 3))
    rotvec[:, : pose.shape[1]] = pose
    rotations = Rotation.from_rotvec(rotvec.reshape(-1, 3)).as_matrix().reshape(-1, _JOINTS, 3, 3)
    joints = shaped_joints(body, np.asarray(betas)[None]).repeat(len(pose), axis=0)
    bones = joint_transforms(rotations, joints, body.parents, np.zeros((len(pose), 3)))
    linear = bones[..., :3, :3].transpose(1, 0, 2, 3).reshape(_JOINTS, -1)
    blended = (body.weights @ linear).reshape(-1, len(pose), 3, 3)
    return blended.transpose(1, 0, 2, 3)
