"""Shape and poses together: betas from one frame, as in the paper, or from several at once.

The normal equations of one body in B poses have a block for each pose, coupled by the betas alone.
So poses are eliminated one by one, and 10 equations are left (the Schur complement).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.robust.gauss_newton import moved, normal_equations, solve_damped
from torch_align_ae.alignment.robust.initial_pose import initial_pose
from torch_align_ae.alignment.robust.sample import Frames, Pose, SampledPatch, Shaped, SkinSample


class ShapeEvidence(NamedTuple):
    """What some frames say about the betas, whatever the poses: sums over the frames."""

    curvature: Tensor
    """(10, 10)."""
    pull: Tensor
    """(10,)."""

    def plus(self, other: ShapeEvidence) -> ShapeEvidence:
        """Of both lots of frames."""
        return ShapeEvidence(self.curvature + other.curvature, self.pull + other.pull)

    def change(self) -> Tensor:
        """(10,) the step of the betas, float64."""
        return solve_damped(self.curvature, self.pull)


def fit_shape(sample: SkinSample, target: Tensor, steps: int) -> Tensor:
    """betas (10,) of the one body that is seen in all frames (B, 3, N) of `target`, metres.

    Every vertex counts alike: how soft they are is not known before the shape is.
    """
    betas = target.new_zeros(len(sample.smpl.shapedirs))
    pose = initial_pose(sample, sample.shaped(betas), target)
    alike = target.new_ones(len(sample))
    for _ in range(steps):
        evidence, (free, less) = _eliminate(sample, sample.shaped(betas), pose, target, alike)
        change = evidence.change()
        frames = sample.frames(sample.shaped(betas), pose)
        pose = moved(sample, frames, pose, (free - less @ change).to(target.dtype))
        betas = betas + change.to(target.dtype)
    return betas


def shape_evidence(
    sample: SkinSample, shaped: Shaped, pose: Pose, target: Tensor, weights: Tensor
) -> ShapeEvidence:
    """About a body in B poses.

    Parameters
    ----------
    target : (B, 3, N) metres.
    weights : (N,) of the squared distances.
    """
    return _eliminate(sample, shaped, pose, target, weights)[0]


def _eliminate(
    sample: SkinSample, shaped: Shaped, pose: Pose, target: Tensor, weights: Tensor
) -> tuple[ShapeEvidence, tuple[Tensor, Tensor]]:
    """Evidence, and how poses answer: (B, 69) with fixed betas, (B, 69, 10) less by the betas."""
    frames = sample.frames(shaped, pose)
    by_betas = partial(_by_betas, sample, frames, _shifts_by_betas(sample, frames))
    curvature, pull = normal_equations(sample, shaped, frames, target, weights.sqrt(), by_betas)
    shapes = len(sample.smpl.shapedirs)
    mixed = curvature[:, shapes:, :shapes]
    right = torch.cat([pull[:, shapes:, None], mixed], 2)
    answers = solve_damped(curvature[:, shapes:, shapes:], right)
    free, less = answers[..., 0], answers[..., 1:]
    evidence = ShapeEvidence(
        (curvature[:, :shapes, :shapes] - mixed.mT @ less).sum(0),
        (pull[:, :shapes] - (mixed.mT @ free[..., None])[..., 0]).sum(0),
    )
    return evidence, (free, less)


def _by_betas(sample: SkinSample, frames: Frames, shifts: Tensor, patch: SampledPatch) -> Tensor:
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
