from __future__ import annotations

import torch

from torch_align_ae.alignment.gauss_newton import fit_poses, fit_shape, initial_pose, solve_damped
from torch_align_ae.alignment.skin_sample import SkinSample
from torch_align_ae.body.rotations import axis_angle_to_matrix, matrix_to_axis_angle


def angles(found, pose):
    """Angle between two rotations of each joint, radians."""
    return matrix_to_axis_angle(found.mT @ axis_angle_to_matrix(pose)).norm(dim=-1)


def test_poses_of_exact_meshes_are_found(sample, smpl, betas, lively):
    pose, trans = lively(6)
    target = sample.select(smpl(betas.expand(6, -1), pose, trans))
    shaped = sample.shaped(betas)
    start = initial_pose(shaped, target)
    found = fit_poses(shaped, target, torch.ones(len(sample)), start, 6)
    # Float32 vertices a metre from the root are good to a tenth of a micrometre.
    assert angles(found.rotations, pose).max() < 1e-4
    torch.testing.assert_close(found.trans, trans, rtol=0, atol=1e-5)


def test_a_batch_is_its_singles(sample, smpl, betas, lively):
    pose, trans = lively(3)
    target = sample.select(smpl(betas.expand(3, -1), pose, trans)) + 0.001
    shaped, weights = sample.shaped(betas), torch.linspace(0.1, 1, len(sample))
    start = initial_pose(shaped, target)
    batch = fit_poses(shaped, target, weights, start, 3)
    for row in range(3):
        one = slice(row, row + 1)
        alone = fit_poses(shaped, target[one], weights, initial_pose(shaped, target[one]), 3)
        torch.testing.assert_close(alone.rotations, batch.rotations[one], rtol=0, atol=1e-4)


def test_vertices_without_weight_are_not_looked_at(sample, smpl, betas, lively):
    pose, trans = lively(2)
    exact = sample.select(smpl(betas.expand(2, -1), pose, trans))
    weights = torch.ones(len(sample))
    weights[::3] = 1e-12
    spoilt = exact.clone()
    spoilt[:, :, ::3] += 0.05
    shaped = sample.shaped(betas)
    start = initial_pose(shaped, exact)
    found = fit_poses(shaped, spoilt, weights, start, 6)
    assert angles(found.rotations, pose).max() < 1e-3


def test_what_nothing_determines_stays_finite():
    curvature = torch.zeros(1, 4, 4)
    curvature[0, 0, 0] = 2.0
    change = solve_damped(curvature, torch.tensor([[1.0, 0.0, 0.0, 0.0]]))
    torch.testing.assert_close(change[0, 0], torch.tensor(0.5).double(), rtol=1e-5, atol=0)
    torch.testing.assert_close(change[0, 1:], torch.zeros(3).double())


def test_shape_is_found_from_one_frame_and_from_several(sample, smpl, betas, lively):
    pose, trans = lively(3, seed=1)
    target = sample.select(smpl(betas.expand(3, -1), pose, trans))
    for frames in (target[:1], target):
        torch.testing.assert_close(fit_shape(sample, frames, 10), betas, rtol=0, atol=2e-4)


def test_several_frames_average_what_deforms_each(sample, smpl, betas, lively):
    pose, trans = lively(6, seed=2)
    meshes = smpl(betas.expand(6, -1), pose, trans)
    noise = 0.004 * torch.randn(meshes.shape, generator=torch.Generator().manual_seed(0))
    target = sample.select(meshes + noise)
    one, many = (fit_shape(sample, frames, 10) for frames in (target[:1], target))
    assert (many - betas).norm() < (one - betas).norm()


def test_sample_keeps_every_limb(smpl):
    whole, few = SkinSample(smpl, 6890), SkinSample(smpl, 300)
    assert sorted(whole.vertices.tolist()) == list(range(6890))
    assert 250 < len(few) < 400
    assert len(few.patches) == len(whole.patches)
    assert [patch.joints.tolist() for patch in few.patches] != []
    carried = torch.cat([patch.weights.sum(0) for patch in few.patches])
    torch.testing.assert_close(carried, torch.ones(len(few)), rtol=0, atol=1e-5)
