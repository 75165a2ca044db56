"""Shape and poses together: betas from one frame, as in the paper, or from several at once."""

from __future__ import annotations

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.robust.gauss_newton import moved, solve_damped
from torch_align_ae.alignment.robust.initial_pose import initial_pose
from torch_align_ae.alignment.robust.linearise import linearise
from torch_align_ae.alignment.robust.sample import Frames, SampledPatch, Shaped, SkinSample

_POSE_UNKNOWNS = 3 * N_JOINTS + 3


def fit_shape(sample: SkinSample, target: Tensor, steps: int) -> Tensor:
    """betas (10,) of the one body that is seen in all frames (B, 3, N) of `target`, metres.

    Every vertex counts alike: how soft they are is not known before the shape is.
    """
    betas = target.new_zeros(len(sample.smpl.shapedirs))
    pose = initial_pose(sample, sample.shaped(betas), target)
    for _ in range(steps):
        shaped = sample.shaped(betas)
        frames = sample.frames(shaped, pose)
        curvature, pull = _joint_equations(sample, shaped, frames, target)
        change = solve_damped(curvature, pull).to(target.dtype)
        betas = betas + change[: len(betas)]
        pose = moved(sample, frames, pose, change[len(betas) :].view(-1, _POSE_UNKNOWNS))
    return betas


def _joint_equations(
    sample: SkinSample, shaped: Shaped, frames: Frames, target: Tensor
) -> tuple[Tensor, Tensor]:
    """Normal equations of the betas and, frame after frame, the 69 unknowns of the poses."""
    shapes, count = len(sample.smpl.shapedirs), len(target)
    shifts = _shifts_by_betas(sample, frames)
    size = shapes + count * _POSE_UNKNOWNS
    curvature, pull = target.new_zeros(size, size), target.new_zeros(size)
    parents = torch.tensor(sample.parents).clamp_min(0)
    for patch in sample.patches:
        scale = target.new_ones(patch.weights.shape[1])
        posed, jacobian = linearise(patch, shaped, frames, frames.features, scale, parents)
        by_shape = _by_betas(sample, patch, frames, shifts).flatten(2)
        residual = (target[:, :, patch.vertices] - posed).flatten(1)
        unknowns = torch.cat([patch.joints, torch.tensor([N_JOINTS])])
        of_pose = (3 * unknowns[:, None] + torch.arange(3)).flatten()
        for frame in range(count):
            places = torch.cat([torch.arange(shapes), shapes + frame * _POSE_UNKNOWNS + of_pose])
            rows = torch.cat([by_shape[frame], jacobian[frame].flatten(2).flatten(0, 1)])
            curvature[places[:, None], places] += rows @ rows.T
            pull[places] += rows @ residual[frame]
    return curvature, pull


def _by_betas(sample: SkinSample, patch: SampledPatch, frames: Frames, shifts: Tensor) -> Tensor:
    """(B, 10, 3, n) derivative of a patch's posed vertices by the betas."""
    shapedirs = sample.smpl.shapedirs[:, :, sample.vertices[patch.vertices]]
    turn = frames.turn[:, patch.bones]
    blended = torch.einsum("bkxi,kn->bxin", turn, patch.weights)
    by_skin = torch.einsum("bxin,sin->bsxn", blended, shapedirs)
    return by_skin + torch.einsum("bskx,kn->bsxn", shifts[:, :, patch.bones], patch.weights)


def _shifts_by_betas(sample: SkinSample, frames: Frames) -> Tensor:
    """(B, 10, 22, 3) derivative of `frames.shift` by the betas, through the joints' places."""
    by_betas = sample.smpl.joint_shapedirs[:, :N_JOINTS]
    places = [sample.places(frames.rotations, joints) for joints in by_betas]
    turned = torch.einsum("bjxy,sjy->bsjx", frames.turn, by_betas)
    return torch.stack(places, 1) - turned
