"""From MakeHuman's A-pose to SMPL's T-pose: arms along x, pelvis at the origin."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_PARENTS
from tools.embedded_body.skinning import apply_transforms, dual_quaternion_transforms
from tools.embedded_body.symmetry import MIRRORED_JOINT, symmetric_points

# Shoulder, elbow, wrist, hand; each joint is aimed at the next.
_ARMS = {+1.0: (16, 18, 20, 22), -1.0: (17, 19, 21, 23)}


def to_tpose(
    vertices: np.ndarray, joints: np.ndarray, weights: np.ndarray, mirror: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bodies (N, V, 3) and joints (N, 24, 3) in the T-pose, pelvis at the origin.

    Dual quaternion skinning is used, because linear blending dents the raised shoulders.
    """
    straightened = [_straighten_arms(*body, weights) for body in zip(vertices, joints, strict=True)]
    posed, posed_joints = map(np.array, zip(*straightened, strict=True))
    posed = symmetric_points(posed, mirror)
    posed_joints = symmetric_points(posed_joints, MIRRORED_JOINT)
    pelvis = posed_joints[:, :1].copy()
    return posed - pelvis, posed_joints - pelvis


def _straighten_arms(
    vertices: np.ndarray, joints: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    rotations = _arm_rotations(joints)
    posed_joints = joints.copy()
    for joint, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            bone = joints[joint] - joints[parent]
            posed_joints[joint] = posed_joints[parent] + rotations[parent] @ bone
    bones = np.tile(np.eye(4), (len(joints), 1, 1))
    bones[:, :3, :3] = rotations
    bones[:, :3, 3] = posed_joints - np.einsum("jxy,jy->jx", rotations, joints)
    transforms = dual_quaternion_transforms(bones, weights)
    return apply_transforms(transforms, vertices), posed_joints


def _arm_rotations(joints: np.ndarray) -> np.ndarray:
    """(24, 3, 3) world rotation of each joint."""
    rotations = np.tile(np.eye(3), (len(joints), 1, 1))
    for side, chain in _ARMS.items():
        for joint, child in pairwise(chain):
            rotations[joint] = _shortest_rotation(
                joints[child] - joints[joint], np.array([side, 0.0, 0.0])
            )
        rotations[chain[-1]] = rotations[chain[-2]]
    return rotations


def _shortest_rotation(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    source = source / np.linalg.norm(source)
    axis = np.cross(source, target)
    sine, cosine = np.linalg.norm(axis), source @ target
    if sine < 1e-9:
        return np.eye(3)
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)).as_matrix()
