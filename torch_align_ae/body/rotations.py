"""Axis-angle vectors and rotation matrices, with gradients that stay finite at zero and at pi."""

from __future__ import annotations

import torch
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
    # Safe to divide by where the series stands in, too.
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
    """Axis-angle vectors (..., 3), angle at most pi, of rotation matrices (..., 3, 3).

    Through the largest of the quaternion's components, so it is exact at every angle; not meant
    for gradients.
    """
    m00, m11, m22 = matrix[..., 0, 0], matrix[..., 1, 1], matrix[..., 2, 2]
    x, y, z = axial_vector(matrix).unbind(-1)
    xy, xz, yz = (matrix[..., i, j] + matrix[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    # Four parallel quaternions, (4, ..., 4) with w first, each scaled by one of its components.
    rows = [
        [1 + m00 + m11 + m22, x, y, z],
        [x, 1 + m00 - m11 - m22, xy, xz],
        [y, xy, 1 - m00 + m11 - m22, yz],
        [z, xz, yz, 1 - m00 - m11 + m22],
    ]
    candidates = torch.stack([torch.stack(row, -1) for row in rows], -2)
    best = candidates.norm(dim=-1).argmax(-1)[..., None, None].expand(*matrix.shape[:-2], 1, 4)
    quaternion = torch.gather(candidates, -2, best)[..., 0, :]
    quaternion = quaternion * torch.where(quaternion[..., :1] < 0, -1.0, 1.0)
    sine = quaternion[..., 1:].norm(dim=-1, keepdim=True)
    angle = 2 * torch.atan2(sine, quaternion[..., :1])
    return quaternion[..., 1:] * angle / sine.clamp_min(torch.finfo(matrix.dtype).tiny)


def nearest_rotation(matrix: Tensor) -> Tensor:
    """Rotations nearest to matrices (..., 3, 3): orthogonal Procrustes, in float64."""
    left, _, right = torch.linalg.svd(matrix.double())
    handedness = torch.ones_like(left[..., 0])
    handedness[..., 2] = torch.det(left @ right)
    return ((left * handedness[..., None, :]) @ right).to(matrix.dtype)


def nearest_turns(axis_angle: Tensor, before: Tensor | None = None) -> Tensor:
    """The same rotations, axis-angle (T, J, 3), as a motion without jumps of a full turn.

    To each frame, its angles at most pi, whole turns are added that bring it nearest to the one
    before; `before` (J, 3) is the frame before the first.
    """
    angle = axis_angle.norm(dim=-1, keepdim=True)
    # A rotation by nothing has no axis along which a turn could be added.
    turn = 2 * torch.pi * axis_angle / angle.clamp_min(1e-6)
    frames, last = [], axis_angle[0] if before is None else before
    for frame, whole in zip(axis_angle, turn, strict=True):
        missing = ((last - frame) * whole).sum(-1, keepdim=True) / (2 * torch.pi) ** 2
        last = frame + missing.round() * whole
        frames.append(last)
    return torch.stack(frames)


def cross_matrix(vector: Tensor) -> Tensor:
    """Matrices (..., 3, 3) whose product with b is the cross product of `vector` (..., 3) and b."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))


def axial_vector(matrix: Tensor) -> Tensor:
    """Axial vector (..., 3) of twice the antisymmetric part of `matrix` (..., 3, 3)."""
    pairs = ((2, 1), (0, 2), (1, 0))
    return torch.stack([matrix[..., i, j] - matrix[..., j, i] for i, j in pairs], -1)
