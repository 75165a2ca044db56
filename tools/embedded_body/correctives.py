"""Pose blend shapes: what better skinning adds to linear blending, made linear in R - I.

The better skinning is a mean of two. Dual quaternions keep the volume of a bend but push elbows,
knees and buttocks outwards; direct delta mush smooths creases but shrinks the bend.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from bridge.body.model_data import JOINT_COUNT, POSE_FEATURE_COUNT, SMPL_PARENTS
from bridge.body.posing import joint_transforms, pose_features
from tools.embedded_body.pose_samples import sample_poses
from tools.embedded_body.skinning import (
    DirectDeltaMush,
    apply_transforms,
    dual_quaternion_transforms,
)
from tools.embedded_body.symmetry import mirrored_posedirs, mirrored_poses

FIT_POSE_COUNT = 400
UNSEEN_POSE_COUNT = 100
SMOOTHING_STEPS = 3
DUAL_QUATERNION_SHARE = 0.55
# Joints with a smaller share of a vertex's smoothed weight do not correct it.
_MIN_WEIGHT = 0.02
_RIDGE = 1e-3


@dataclass(frozen=True)
class CorrectiveFit:
    """Pose blend shapes and how well they imitate their model."""

    posedirs: np.ndarray
    """(V, 3, 207) metres per unit of R - I."""
    r2_fit: float
    """Share of the correction's square that is explained, poses of the fit, posed frame."""
    r2_unseen: float
    """The same on poses that the fit has not seen."""
    lbs_error_m: float
    """Root mean square distance of linear blending from better skinning, unseen poses."""
    largest_m: float
    """Largest displacement in the rest frame over the unseen poses."""


@dataclass(frozen=True)
class _PosedSet:
    features: np.ndarray  # (N, 207)
    blended: np.ndarray  # (N, V, 3, 3), linear part of linear blending
    correction_m: np.ndarray  # (N, V, 3), posed frame

    def residual(self, posedirs: np.ndarray) -> np.ndarray:
        added = np.einsum("vxp,np->nvx", posedirs, self.features, optimize=True)
        return self.correction_m - np.einsum("nvxy,nvy->nvx", self.blended, added, optimize=True)

    def r2(self, posedirs: np.ndarray) -> float:
        return float(1.0 - (self.residual(posedirs) ** 2).sum() / (self.correction_m**2).sum())


def fit_pose_correctives(
    template: np.ndarray,
    faces: np.ndarray,
    joints: np.ndarray,
    weights: np.ndarray,
    mirror: np.ndarray,
) -> CorrectiveFit:
    """Ridge regression of each vertex's correction on the rotations of the joints near it.

    The error is measured after skinning, where it is seen: minimise over each vertex's P
    |M_n P (R_n - I) - d_n|^2, with M_n the vertex's blended matrix in pose n and d_n what better
    skinning adds there. At rest R = I, so the T-pose is untouched.
    """
    mush = DirectDeltaMush(template, faces, weights, SMOOTHING_STEPS)
    poses = sample_poses(FIT_POSE_COUNT // 2, 0)
    poses = np.concatenate([poses, mirrored_poses(poses)])
    fitted = _pose_set(poses, template, joints, weights, mush)
    posedirs = np.zeros((*template.shape, POSE_FEATURE_COUNT))
    for columns, vertices in _neighbourhoods(mush.weights):
        posedirs[np.ix_(vertices, np.arange(3), columns)] = _ridge(fitted, vertices, columns)
    posedirs = (posedirs + mirrored_posedirs(posedirs, mirror)) / 2
    unseen = _pose_set(sample_poses(UNSEEN_POSE_COUNT, 1), template, joints, weights, mush)
    added = np.einsum("vxp,np->nvx", posedirs, unseen.features, optimize=True)
    return CorrectiveFit(
        posedirs=posedirs,
        r2_fit=fitted.r2(posedirs),
        r2_unseen=unseen.r2(posedirs),
        lbs_error_m=float(np.sqrt((unseen.correction_m**2).sum(axis=-1).mean())),
        largest_m=float(np.linalg.norm(added, axis=-1).max()),
    )


def _pose_set(
    poses: np.ndarray,
    template: np.ndarray,
    joints: np.ndarray,
    weights: np.ndarray,
    mush: DirectDeltaMush,
) -> _PosedSet:
    rotations = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix()
    rotations = rotations.reshape(len(poses), JOINT_COUNT, 3, 3)
    rest_joints = np.broadcast_to(joints, (len(poses), JOINT_COUNT, 3))
    trans = np.zeros((len(poses), 3))
    bones = joint_transforms(rotations, rest_joints, np.array(SMPL_PARENTS), trans)
    blended = np.empty((len(poses), len(template), 3, 3), dtype=np.float32)
    correction_m = np.empty((len(poses), *template.shape), dtype=np.float32)
    for index, pose_bones in enumerate(tqdm(bones, "better skinning", disable=None)):
        linear = np.einsum("vj,jxy->vxy", weights, pose_bones, optimize=True)
        wanted = _better_skinning(pose_bones, template, weights, mush)
        blended[index] = linear[:, :3, :3]
        correction_m[index] = wanted - apply_transforms(linear, template)
    return _PosedSet(pose_features(rotations), blended, correction_m)


def _better_skinning(
    bones: np.ndarray, template: np.ndarray, weights: np.ndarray, mush: DirectDeltaMush
) -> np.ndarray:
    volumetric = apply_transforms(dual_quaternion_transforms(bones, weights), template)
    smooth = apply_transforms(mush.transforms(bones), template)
    return DUAL_QUATERNION_SHARE * volumetric + (1.0 - DUAL_QUATERNION_SHARE) * smooth


def _neighbourhoods(weights: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Groups of vertices with the same correcting joints: (feature columns, vertices).

    A vertex between bones a and b is bent by the joints on the path from a to b, their common
    ancestor excepted, which moves both alike.
    """
    patterns, group = np.unique(weights > _MIN_WEIGHT, axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        bending = _bending_joints(np.flatnonzero(pattern))
        if bending:
            columns = np.concatenate([np.arange(9) + 9 * (joint - 1) for joint in bending])
            yield columns, np.flatnonzero(group.ravel() == index)


def _bending_joints(joints: np.ndarray) -> list[int]:
    chains = [set(_ancestors(int(joint))) for joint in joints]
    return sorted(set.union(*chains) - set.intersection(*chains))


def _ancestors(joint: int) -> Iterator[int]:
    while joint >= 0:
        yield joint
        joint = SMPL_PARENTS[joint]


def _ridge(poses: _PosedSet, vertices: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(len(vertices), 3, len(columns)) solutions, one independent problem a vertex."""
    count, width = len(vertices), 3 * len(columns)
    features = poses.features[:, columns]
    blended = poses.blended[:, vertices].astype(np.float64)
    squared = np.einsum("nvzx,nvzy->nvxy", blended, blended)
    pulled = np.einsum("nvzx,nvz->nvx", blended, poses.correction_m[:, vertices])
    outer = (features[:, :, None] * features[:, None, :]).reshape(len(features), -1)
    gram = (outer.T @ squared.reshape(len(features), -1)).reshape(
        len(columns), len(columns), count, 3, 3
    )
    gram = gram.transpose(2, 3, 0, 4, 1).reshape(count, width, width)
    right = (features.T @ pulled.reshape(len(features), -1)).reshape(len(columns), count, 3)
    right = right.transpose(1, 2, 0).reshape(count, width)
    ridge = _RIDGE * len(features) * np.eye(width)
    return np.linalg.solve(gram + ridge, right[..., None]).reshape(count, 3, len(columns))
