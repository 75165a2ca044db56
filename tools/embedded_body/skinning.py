"""Skinning that is better than linear blending: what the pose blend shapes imitate."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.spatial.transform import Rotation


def dual_quaternion_transforms(bones: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Rigid transform (V, 4, 4) of each vertex by dual quaternion blending (Kavan 2007).

    Parameters
    ----------
    bones : (J, 4, 4) rigid transforms.
    weights : (V, J) skinning weights.
    """
    real = Rotation.from_matrix(bones[:, :3, :3]).as_quat()
    # Of q and -q, take the one on the side of each vertex's strongest bone.
    pivot = real[weights.argmax(axis=1)]
    signed_weights = weights * np.where(pivot @ real.T < 0, -1.0, 1.0)
    dual = 0.5 * _multiply(np.c_[bones[:, :3, 3], np.zeros(len(bones))], real)
    blended_real, blended_dual = signed_weights @ real, signed_weights @ dual
    norm = np.linalg.norm(blended_real, axis=1, keepdims=True)
    blended_real, blended_dual = blended_real / norm, blended_dual / norm
    transforms = np.tile(np.eye(4), (len(weights), 1, 1))
    transforms[:, :3, :3] = Rotation.from_quat(blended_real).as_matrix()
    conjugate = blended_real * [-1.0, -1.0, -1.0, 1.0]
    transforms[:, :3, 3] = 2.0 * _multiply(blended_dual, conjugate)[:, :3]
    return transforms


def apply_transforms(transforms: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """(V, 3) vertices, each moved by its own (V, 4, 4) transform."""
    return np.einsum("vxy,vy->vx", transforms[:, :3, :3], vertices) + transforms[:, :3, 3]


def _multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Product of quaternions (N, 4), scalar last; unlike rotations they need no unit norm."""
    vector = p[:, 3:] * q[:, :3] + q[:, 3:] * p[:, :3] + np.cross(p[:, :3], q[:, :3])
    scalar = p[:, 3:] * q[:, 3:] - (p[:, :3] * q[:, :3]).sum(axis=1, keepdims=True)
    return np.concatenate([vector, scalar], axis=1)


class DirectDeltaMush:
    """Direct delta mush (Le and Lewis 2019): skinning that keeps volume without bulges.

    Each vertex gets the rigid motion that best moves its neighbourhood as linear blending would;
    dual quaternions, by contrast, push bent elbows and knees outwards.
    """

    def __init__(
        self, vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray, smoothing_steps: int
    ) -> None:
        self._vertices = vertices
        smooth = _smoothing_matrix(len(vertices), faces)
        homogeneous = np.c_[vertices, np.ones(len(vertices))]
        moments = np.einsum("vj,vx,vy->vjxy", weights, homogeneous, homogeneous)
        flat = moments.reshape(len(vertices), -1)
        self.weights = weights
        for _ in range(smoothing_steps):
            flat, self.weights = smooth @ flat, smooth @ self.weights
        self._moments = flat.reshape(moments.shape)

    def transforms(self, bones: np.ndarray) -> np.ndarray:
        """Rigid transform (V, 4, 4) of each vertex for bones (J, 4, 4)."""
        blended = np.einsum("jxz,vjzy->vxy", bones, self._moments)
        source, target = blended[:, 3, :3], blended[:, :3, 3]
        covariance = blended[:, :3, :3] - target[:, :, None] * source[:, None, :]
        left, _, right = np.linalg.svd(covariance)
        # The third direction's sign makes it a rotation and not a reflection.
        left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
        transforms = np.tile(np.eye(4), (len(source), 1, 1))
        transforms[:, :3, :3] = left @ right
        moved = np.einsum("vxy,vy->vx", transforms[:, :3, :3], source)
        transforms[:, :3, 3] = target - moved
        return transforms


def _smoothing_matrix(vertex_count: int, faces: np.ndarray) -> sp.csr_matrix:
    """Mean of each vertex and its neighbours, half and half."""
    a, b = np.concatenate([faces, np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)])[:, :2].T
    adjacency = sp.csr_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])))
    adjacency.data[:] = 1.0
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    return 0.5 * (sp.eye(vertex_count) + sp.diags(1.0 / degree) @ adjacency).tocsr()
