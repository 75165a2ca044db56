"""Second-order fitting of poses: damped Gauss-Newton on weighted vertex distances.

With residuals r = s - x(theta) at weights w and the Jacobian J of x, a step solves

    (J^T W J + damping) change = J^T W r,

the minimum of the squared distances if x were linear. Unknowns are turns about the world's axes,
not axis-angle components: their Jacobian is a cross product (`linearise`) and has no singular
poses. A patch depends on a few joints only, so its J^T W J is a small block of the whole.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.robust.linearise import linearise
from torch_align_ae.alignment.robust.sample import Frames, Pose, Shaped, SkinSample
from torch_align_ae.body.rotations import axis_angle_to_matrix

_UNKNOWNS = 3 * N_JOINTS + 3
# Relative to each unknown's own curvature. Leaves a millionth of a well-determined step undone
# and keeps the undetermined ones (the twist of a limb of which nothing is seen) finite.
_DAMPING = 1e-6


class NormalEquations(NamedTuple):
    """The quadratic model of B bodies' squared distances about their poses."""

    curvature: Tensor
    """(B, 69, 69): 22 turns about the world's axes, then the translation."""
    pull: Tensor
    """(B, 69) half the descent direction."""


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
        pose = step(sample, frames, pose, equations)
    return pose


def normal_equations(
    sample: SkinSample, shaped: Shaped, frames: Frames, target: Tensor, scale: Tensor
) -> NormalEquations:
    """Sums over all patches; `scale` (N,) is the square root of the weights."""
    count, features = len(target), frames.features
    parents = torch.tensor(sample.parents).clamp_min(0)
    curvature = target.new_zeros(count, N_JOINTS + 1, 3, N_JOINTS + 1, 3)
    pull = target.new_zeros(count, N_JOINTS + 1, 3)
    for patch in sample.patches:
        own = scale[patch.vertices]
        posed, jacobian = linearise(patch, shaped, frames, features, own, parents)
        residual = torch.addcmul(-posed, target[:, :, patch.vertices], own)
        rows = jacobian.flatten(3).flatten(1, 2)
        unknowns = torch.cat([patch.joints, torch.tensor([N_JOINTS])])
        size = len(unknowns)
        squares = (rows @ rows.mT).view(count, size, 3, size, 3)
        # Indexed one axis after the other: both at once would copy the whole array.
        by_row = curvature.new_zeros(count, size, 3, N_JOINTS + 1, 3)
        by_row[:, :, :, unknowns] = squares
        curvature.index_add_(1, unknowns, by_row)
        forces = (rows @ residual.flatten(1)[..., None]).view(count, size, 3)
        pull.index_add_(1, unknowns, forces)
    return NormalEquations(curvature.view(count, _UNKNOWNS, _UNKNOWNS), pull.flatten(1))


def step(sample: SkinSample, frames: Frames, pose: Pose, equations: NormalEquations) -> Pose:
    """The poses after one damped step."""
    change = solve_damped(equations.curvature, equations.pull).to(pose.trans.dtype)
    return moved(sample, frames, pose, change)


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
