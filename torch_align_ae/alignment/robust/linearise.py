"""Posed vertices and their derivatives by the pose: the analytic Jacobian of Eq. 1-2.

A joint is turned by a small rotation vector about itself, *in the world's axes*: everything that
hangs below it then moves by a cross product with its distance from the joint, so the columns are
sums over the joints below and need no product at all. Pose blend shapes add the displacement of
the rest vertices that the turn brings with it.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torch_align_ae.alignment.robust.sample import (
    Frames,
    SampledPatch,
    Shaped,
    moved_by_bones,
    rest_vertices,
)
from torch_align_ae.body.rotations import cross_matrix


def linearise(
    patch: SampledPatch, shaped: Shaped, frames: Frames, scale: Tensor
) -> tuple[Tensor, Tensor]:
    """Posed vertices of a patch and their Jacobian, both times `scale`.

    Parameters
    ----------
    patch, shaped, frames : C joints, K bones, n vertices, B bodies.
    scale : (n,) square root of each vertex's weight.

    Returns
    -------
    positions : (B, 3, n) metres.
    jacobian : (B, C + 1, 3, 3, n): by the turn of joint c about world axis i, radians, and, last,
        by the translation; then coordinates and vertices.
    """
    weights = patch.weights * scale
    rest = rest_vertices(patch, shaped, frames)
    moved = moved_by_bones(patch, frames, rest, weights)
    arms = (patch.below @ moved.flatten(2)).unflatten(2, (3, -1))
    arms -= (patch.carried * scale)[:, None] * frames.place[:, patch.joints, :, None]
    jacobian = arms.new_zeros(len(rest), len(patch.joints) + 1, 3, 3, rest.shape[2])
    _put_cross_products(jacobian[:, :-1], arms)
    if len(patch.jacobian_posedirs):
        _add_corrections(jacobian, patch, frames, weights)
    for axis in range(3):
        jacobian[:, -1, axis, axis] = scale
    return moved.sum(1), jacobian


def _put_cross_products(jacobian: Tensor, arms: Tensor) -> None:
    """Fill (B, C, 3, 3, n) with e_i x arm for each world axis i."""
    for axis in range(3):
        following, last = (axis + 1) % 3, (axis + 2) % 3
        torch.neg(arms[:, :, last], out=jacobian[:, :, axis, following])
        jacobian[:, :, axis, last] = arms[:, :, following]


def _add_corrections(
    jacobian: Tensor, patch: SampledPatch, frames: Frames, weights: Tensor
) -> None:
    """Add what pose blend shapes do while their joint turns."""
    count = len(patch.jacobian_posedirs)
    joints = patch.joints[:count]
    # In the parent's axes, world axis i is row i of the parent's orientation.
    spin = cross_matrix(frames.turn[:, patch.parents]) @ frames.rotations[:, joints, None]
    spin = spin.transpose(0, 1).flatten(1, 2).flatten(2)  # (P, B * 3, 9)
    rest_change = (spin @ patch.jacobian_posedirs).unflatten(1, (-1, 3)).unflatten(3, (3, -1))
    rest_change = rest_change.transpose(0, 1)  # (B, P, 3 axes, 3 coordinates, n)
    turn = frames.turn[:, patch.bones].permute(0, 2, 3, 1).flatten(1, 2)
    blended = (turn @ weights).unflatten(1, (3, 3))  # (B, 3, 3, n)
    change = blended[:, None, None, :, 0] * rest_change[:, :, :, None, 0]
    for axis in (1, 2):
        change.addcmul_(blended[:, None, None, :, axis], rest_change[:, :, :, None, axis])
    jacobian[:, :count] += change
