"""Second-order fitting of poses: damped Gauss-Newton on weighted vertex distances.

With residuals r = s - x(theta) at weights w and the Jacobian J of x, a step solves

    (J^T W J + damping) change = J^T W r,

the minimum of the squared distances if x were linear. Unknowns are turns about the world's axes,
not axis-angle components: their Jacobian is a cross product (`linearise`) and has no singular
poses. A patch depends on a few joints only, so its J^T W J is a small block of the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.robust.linearise import linearise
from torch_align_ae.alignment.robust.sample import (
    Frames,
    Pose,
    SampledPatch,
    Shaped,
    SkinSample,
)
from torch_align_ae.body.rotations import axis_angle_to_matrix

_POSE_UNKNOWNS = 3 * N_JOINTS + 3
# Relative to each unknown's own curvature. Leaves a millionth of a well-determined step undone
# and keeps the undetermined ones (the twist of a limb of which nothing is seen) finite.
_DAMPING = 1e-6


class NormalEquations(NamedTuple):
    """The quadratic model of B bodies' squared distances about their poses."""

    curvature: Tensor
    """(B, 69, 69): 22 turns about the world's axes, then the translation; of betas and pose
    (B, 79, 79)."""
    pull: Tensor
    """(B, 69) or (B, 79) half the descent direction."""


def fit_poses(
    sample: SkinSample,
    shaped: Shaped,
    target: Tensor,
    weights: Tensor,
    pose: Pose,
    steps: int,
) -> Pose:
    """Poses of one body that bring the sample near to targets.

    Parameters
    ----------
    target : (B, 3, N) sample of the meshes, metres, from `SkinSample.take`.
    weights : (N,) of the squared distances.
    pose : where to start.
    steps : Gauss-Newton steps.
    """
    for _ in range(steps):
        frames = sample.frames(shaped, pose)
        equations = normal_equations(sample, shaped, frames, target, weights.sqrt())
        change = solve_damped(*equations).to(pose.trans.dtype)
        pose = moved(sample, frames, pose, change)
    return pose


def normal_equations(
    sample: SkinSample,
    shaped: Shaped,
    frames: Frames,
    target: Tensor,
    scale: Tensor,
    by_betas: Callable[[SampledPatch], Tensor] | None = None,
) -> NormalEquations:
    """Sums over all patches.

    Parameters
    ----------
    scale : (N,) square root of the weights.
    by_betas : of a patch's posed vertices the derivatives (B, 10, 3, n), by unknowns that come
        before the pose; the sums are then float64.
    """
    shapes = 0 if by_betas is None else len(sample.smpl.shapedirs)
    size, count = shapes + _POSE_UNKNOWNS, len(target)
    curvature = target.new_zeros(count, size, size, dtype=torch.float64 if by_betas else None)
    pull = curvature.new_zeros(count, size)
    for patch in sample.patches:
        own = scale[patch.vertices]
        posed, jacobian = linearise(patch, shaped, frames, own)
        residual = torch.addcmul(-posed, target[:, :, patch.vertices], own).flatten(1)
        rows = jacobian.flatten(3).flatten(1, 2)
        unknowns = torch.cat([patch.joints, torch.tensor([N_JOINTS])])
        places = shapes + (3 * unknowns[:, None] + torch.arange(3)).flatten()
        if by_betas is not None:
            rows = torch.cat([(by_betas(patch) * own).flatten(2), rows], 1)
            places = torch.cat([torch.arange(shapes), places])
        # Indexed one axis after the other: both at once would copy the whole array.
        by_row = curvature.new_zeros(count, len(places), size)
        by_row[:, :, places] = (rows @ rows.mT).to(by_row)
        curvature.index_add_(1, places, by_row)
        pull.index_add_(1, places, (rows @ residual[..., None])[..., 0].to(pull))
    return NormalEquations(curvature, pull)


def solve_damped(curvature: Tensor, pull: Tensor) -> Tensor:
    """(..., U) or (..., U, n) solution in float64.

    Single precision would lose the weakly determined unknowns.

    The damping is relative to each unknown's own curvature, and to their mean where it has none.
    """
    curvature, pull = curvature.double(), pull.double()
    diagonal = curvature.diagonal(dim1=-2, dim2=-1)
    floor = diagonal.mean(-1, keepdim=True)
    damping = _DAMPING * (diagonal + _DAMPING * floor)
    curvature = curvature + torch.diag_embed(damping)
    return torch.linalg.solve(curvature, pull)


def moved(sample: SkinSample, frames: Frames, pose: Pose, change: Tensor) -> Pose:
    """Poses after turns about the world's axes and a translation (B, 69)."""
    turns = change[:, : 3 * N_JOINTS].unflatten(1, (N_JOINTS, 3))
    parents = list(sample.parents[1:])
    in_parent = (frames.turn[:, parents].mT @ turns[:, 1:, :, None])[..., 0]
    turns = torch.cat([turns[:, :1], in_parent], 1)
    rotations = axis_angle_to_matrix(turns) @ pose.rotations
    return Pose(rotations, pose.trans + change[:, 3 * N_JOINTS :])
