"""Second-order fitting of poses and shape: damped Gauss-Newton on weighted vertex distances.

With residuals r = s - x(theta) at weights w and the Jacobian J of x, a step solves

    (J^T W J + damping) change = J^T W r,

the minimum of the squared distances if x were linear. Unknowns are small rotations about the
world's axes, not axis-angle components: their Jacobian is a cross product (`linearise`) and has no
singular poses. A patch depends on a few joints only, so its J^T W J is a small block of the whole.

The normal equations of one body's shape in B poses have a block for each pose, coupled by the betas
alone. So poses are eliminated one by one, and 10 equations are left (the Schur complement).
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from bridge.paper import N_JOINTS
from torch_align_ae.alignment.skin_sample import Pose, Posed, SampledPatch, Shaped, SkinSample
from torch_align_ae.body.rotations import axis_angle_to_matrix, nearest_rotation

_POSE_UNKNOWNS = 3 * N_JOINTS + 3
# Relative to the curvature by each unknown. It shortens a well-determined step by a millionth and
# keeps undetermined ones finite, such as the twist of a limb without vertices in the sample.
_DAMPING = 1e-6


def initial_pose(shaped: Shaped, target: Tensor) -> Pose:
    """Initial poses by orthogonal Procrustes, bone by bone.

    Blended skinning and pose blend shapes are neglected, so joint angles have errors of a few
    degrees. `target` is the sample (B, 3, N) of the meshes, metres.
    """
    weights = shaped.sample.weights.square()
    weights = weights / weights.sum(1, keepdim=True)
    source = weights @ shaped.vertices.T
    centre = torch.einsum("jn,bxn->bjx", weights, target)
    products = torch.einsum("jn,bxn,yn->bjxy", weights, target, shaped.vertices)
    turn = nearest_rotation(products - centre[..., None] * source[:, None])
    rotations = turn.clone()
    rotations[:, 1:] = turn[:, list(shaped.sample.parents[1:])].mT @ turn[:, 1:]
    root = shaped.joints[0]
    # The root rotates about its joint: R (x - root) + root + trans.
    trans = centre[:, 0] - turn[:, 0] @ (source[0] - root) - root
    return Pose(rotations, trans)


def fit_poses(shaped: Shaped, target: Tensor, weights: Tensor, pose: Pose, steps: int) -> Pose:
    """Fit poses of one body to targets (B, 3, N), metres, by weighted least squares.

    `weights` (N,) are those of the squared distances, `pose` is the initial pose.
    """
    for _ in range(steps):
        posed = shaped.posed(pose)
        change = solve_damped(*normal_equations(posed, target, weights.sqrt()))
        pose = moved(posed, change.to(pose.trans.dtype))
    return pose


def normal_equations(
    posed: Posed,
    target: Tensor,
    scale: Tensor,
    by_betas: Callable[[SampledPatch], Tensor] | None = None,
) -> tuple[Tensor, Tensor]:
    """The quadratic model of B bodies' squared distances about their poses.

    Curvature (B, 69, 69) by 22 turns about the world's axes, then the translation, and half the
    descent direction (B, 69). `scale` (N,) is the square root of the weights. With `by_betas`, a
    patch's derivatives (B, 10, 3, n), the betas come before the pose; the sums are then float64.
    """
    sample = posed.shaped.sample
    shapes = 0 if by_betas is None else len(sample.smpl.shapedirs)
    size, count = shapes + _POSE_UNKNOWNS, len(target)
    curvature = target.new_zeros(count, size, size, dtype=torch.float64 if by_betas else None)
    pull = curvature.new_zeros(count, size)
    for patch in sample.patches:
        patch_scale = scale[patch.vertices]
        vertices_m, jacobian = patch.linearise(posed, patch_scale)
        scaled_target = target[:, :, patch.vertices]
        residual = torch.addcmul(-vertices_m, scaled_target, patch_scale).flatten(1)
        rows = jacobian.flatten(3).flatten(1, 2)
        unknowns = torch.cat([patch.joints, torch.tensor([N_JOINTS])])
        places = shapes + (3 * unknowns[:, None] + torch.arange(3)).flatten()
        if by_betas is not None:
            rows = torch.cat([(by_betas(patch) * patch_scale).flatten(2), rows], 1)
            places = torch.cat([torch.arange(shapes), places])
        # Indexed one axis after the other, as indexing both would copy the whole array.
        by_row = curvature.new_zeros(count, len(places), size)
        by_row[:, :, places] = (rows @ rows.mT).to(by_row)
        curvature.index_add_(1, places, by_row)
        pull.index_add_(1, places, (rows @ residual[..., None])[..., 0].to(pull))
    return curvature, pull


def solve_damped(curvature: Tensor, pull: Tensor) -> Tensor:
    """(..., U) or (..., U, n) solution in float64: float32 would lose weakly determined unknowns.

    Damping is relative to the curvature by each unknown, or to the mean where that is 0.
    """
    curvature, pull = curvature.double(), pull.double()
    diagonal = curvature.diagonal(dim1=-2, dim2=-1)
    floor = diagonal.mean(-1, keepdim=True)
    damping = _DAMPING * (diagonal + _DAMPING * floor)
    curvature = curvature + torch.diag_embed(damping)
    return torch.linalg.solve(curvature, pull)


def moved(posed: Posed, change: Tensor) -> Pose:
    """Poses after small rotations about the world's axes and a translation (B, 69)."""
    turns = change[:, : 3 * N_JOINTS].unflatten(1, (N_JOINTS, 3))
    parents = list(posed.shaped.sample.parents[1:])
    in_parent = (posed.turn[:, parents].mT @ turns[:, 1:, :, None])[..., 0]
    turns = torch.cat([turns[:, :1], in_parent], 1)
    rotations = axis_angle_to_matrix(turns) @ posed.pose.rotations
    return Pose(rotations, posed.pose.trans + change[:, 3 * N_JOINTS :])


def fit_shape(sample: SkinSample, target: Tensor, steps: int) -> Tensor:
    """betas (10,) of the one body in all frames (B, 3, N) of `target`, metres.

    All vertices have equal weights, as their softness is estimated only after the shape.
    """
    betas = target.new_zeros(len(sample.smpl.shapedirs))
    pose = initial_pose(sample.shaped(betas), target)
    weights = target.new_ones(len(sample))
    for _ in range(steps):
        shaped = sample.shaped(betas)
        curvature, pull, free, less = shape_equations(shaped, pose, target, weights)
        change = solve_damped(curvature, pull)
        pose_change = (free - less @ change).to(target.dtype)
        pose = moved(shaped.posed(pose), pose_change)
        betas = betas + change.to(target.dtype)
    return betas


def shape_equations(
    shaped: Shaped, pose: Pose, target: Tensor, weights: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Normal equations of the betas after eliminating the poses of B frames (B, 3, N), metres.

    Curvature (10, 10) and pull (10,), summed over frames. The optimal change of the poses is then
    `free` (B, 69) less `less` (B, 69, 10) times that of the betas. `weights` (N,) are those of the
    squared distances.
    """
    sample, posed = shaped.sample, shaped.posed(pose)
    joint_shapedirs = sample.smpl.joint_shapedirs[:, :N_JOINTS]
    # (B, 10, 22, 3) derivative of `posed.shift`, which is linear in the joints, by the betas.
    unmoved = pose._replace(trans=torch.zeros_like(pose.trans))
    shapes = [shaped._replace(joints=joints) for joints in joint_shapedirs]
    shifts = torch.stack([one.posed(unmoved).shift for one in shapes], 1)

    def by_betas(patch: SampledPatch) -> Tensor:
        shapedirs = sample.smpl.shapedirs[:, :, sample.vertices[patch.vertices]]
        blended = torch.einsum("bkxi,kn->bxin", posed.turn[:, patch.bones], patch.weights)
        by_skin = torch.einsum("bxin,sin->bsxn", blended, shapedirs)
        return by_skin + torch.einsum("bskx,kn->bsxn", shifts[:, :, patch.bones], patch.weights)

    curvature, pull = normal_equations(posed, target, weights.sqrt(), by_betas)
    size = len(joint_shapedirs)
    mixed = curvature[:, size:, :size]
    answers = solve_damped(curvature[:, size:, size:], torch.cat([pull[:, size:, None], mixed], 2))
    free, less = answers[..., 0], answers[..., 1:]
    curvature = (curvature[:, :size, :size] - mixed.mT @ less).sum(0)
    return curvature, (pull[:, :size] - (mixed.mT @ free[..., None])[..., 0]).sum(0), free, less
