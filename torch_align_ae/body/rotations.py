"""Axis-angle vectors and rotation matrices."""

from __future__ import annotations

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

# Below this squared angle three terms of the series are exact to float64's rounding.
_SERIES_BELOW = 1e-4


def axis_angle_to_matrix(axis_angle: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of axis-angle vectors (..., 3) in radians: Rodrigues' formula.

    The coefficients are smooth functions of the squared angle, so no gradient divides by an
    angle of zero.
    """
    squared = axis_angle.square().sum(-1)[..., None, None]
    small = squared < _SERIES_BELOW
    # Also safe to divide by where the series is used.
    angle = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    series = 1 - squared / 6 + squared**2 / 120
    sine = torch.where(small, series, torch.sin(angle) / angle)
    # (1 - cos a) / a^2, by the half angle because 1 - cos a cancels.
    series = 1 / 2 - squared / 24 + squared**2 / 720
    versine = torch.where(small, series, 2 * (torch.sin(angle / 2) / angle) ** 2)
    cross = cross_matrix(axis_angle)
    identity = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return identity + sine * cross + versine * (cross @ cross)


def matrix_to_axis_angle(matrix: Tensor) -> Tensor:
    """Axis-angle vectors (..., 3), angle at most pi, of rotations (..., 3, 3); no gradients."""
    vectors = Rotation.from_matrix(matrix.reshape(-1, 3, 3).double().numpy()).as_rotvec()
    return torch.from_numpy(vectors).to(matrix).view(matrix.shape[:-1])


def nearest_rotation(matrix: Tensor) -> Tensor:
    """Rotations nearest to matrices (..., 3, 3): orthogonal Procrustes, in float64."""
    left, _, right = torch.linalg.svd(matrix.double())
    handedness = torch.ones_like(left[..., 0])
    handedness[..., 2] = torch.det(left @ right)
    return ((left * handedness[..., None, :]) @ right).to(matrix.dtype)


def cross_matrix(vector: Tensor) -> Tensor:
    """Matrices (..., 3, 3) whose product with b is the cross product of `vector` (..., 3) and b."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
