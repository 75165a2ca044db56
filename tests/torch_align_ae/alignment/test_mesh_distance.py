"""The mesh distance and its gradient by hand, against walks of the tree and autograd."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torch_align_ae import SMPL
from torch_align_ae.alignment.joint_tree import JointTree
from torch_align_ae.alignment.mesh_distance import MeshDistance
from torch_align_ae.body.rotations import axis_angle_to_matrix
from torch_align_ae.body.smpl import bone_transforms


def random_tree(seed):
    """Parents before children; a chain, a star and everything between."""
    draw = np.random.default_rng(seed)
    return (-1, *(int(draw.integers(max(0, j - 1 - seed % 5), j)) for j in range(1, 9)))


@given(st.integers(0, 10_000))
def test_bones_are_those_of_the_level_by_level_walk(seed):
    parents, generator = random_tree(seed), torch.Generator().manual_seed(seed)
    joints, pose = torch.randn(2, 2, 9, 3, generator=generator, dtype=torch.float64)
    trans = torch.randn(2, 3, generator=generator, dtype=torch.float64)
    bones = JointTree(parents, torch.float64).move(joints, pose, trans)
    found = bones.T_world_rest.permute(2, 3, 0, 1)
    rotations = axis_angle_to_matrix(pose)
    expected = bone_transforms(rotations, joints, parents, trans)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@given(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1),
    # Around zero, around the least angle that is divided by, around pi and beyond.
    st.one_of(st.floats(0, 2e-4), st.floats(3.14159, np.pi), st.floats(0, 2 * np.pi)),
)
def test_a_bones_jacobian_is_the_derivative_of_its_rotation(axis, angle):
    pose = torch.from_numpy(np.array(axis) / np.linalg.norm(axis) * angle)
    at_rest = torch.zeros(1, 1, 3, dtype=torch.float64)
    bones = JointTree((-1,), torch.float64).move(at_rest, pose.view(1, 1, 3), at_rest[0])
    rotation = axis_angle_to_matrix(pose)
    by_pose = torch.autograd.functional.jacobian(axis_angle_to_matrix, pose)
    spin = torch.einsum("ijk,lj->kil", by_pose, rotation)
    turns = spin[:, [2, 0, 1], [1, 2, 0]].T
    np.testing.assert_allclose(bones.jacobian[..., 0, 0], turns, atol=1e-12)
    np.testing.assert_allclose(bones.pose_features[..., 0, 0], rotation - torch.eye(3), atol=1e-12)


def random_problem(smpl, dtype, seed=0):
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape, scale=1.0):
        return scale * torch.randn(shape, generator=generator, dtype=dtype)

    betas, pose, trans = draw(3, 10), draw(3, 22, 3, scale=0.5), draw(3, 3)
    target = smpl(betas + 0.1, pose + draw(3, 22, 3, scale=0.05), trans + 0.02)
    return betas, pose, trans, target


def by_hand(smpl, betas, pose, trans, target):
    objective = MeshDistance(smpl)
    distance = objective.to(objective.arrange(target))
    gradient = distance.gradient(objective.shapes(betas), pose, trans)
    by_betas = distance.betas_gradient()
    return [gradient.distance, by_betas, gradient.pose, gradient.trans]


def by_autograd(smpl, betas, pose, trans, target):
    variables = [tensor.clone().requires_grad_() for tensor in (betas, pose, trans)]
    distance = (smpl(*variables) - target).flatten(1).norm(dim=1)
    return [distance.detach(), *torch.autograd.grad(distance.sum(), variables)]


def assert_same(found, expected, rtol):
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=rtol, atol=rtol * float(other.abs().max()))


@pytest.mark.parametrize(("dtype", "rtol"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
def test_gradient_is_autograds(body, dtype, rtol):
    smpl = SMPL(body, dtype)
    problem = random_problem(smpl, dtype)
    assert_same(by_hand(smpl, *problem), by_autograd(smpl, *problem), rtol)


def test_gradient_is_autograds_with_dense_pose_blend_shapes(body):
    posedirs = np.random.default_rng(0).normal(0, 0.002, body.posedirs.shape)
    smpl = SMPL(dataclasses.replace(body, posedirs=posedirs), torch.float64)
    problem = random_problem(smpl, torch.float64)
    assert_same(by_hand(smpl, *problem), by_autograd(smpl, *problem), 1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-5, np.pi])
def test_gradient_at_special_angles(body, angle):
    smpl = SMPL(body, torch.float64)
    betas, pose, trans, target = random_problem(smpl, torch.float64)
    pose = torch.nn.functional.normalize(pose, dim=-1) * angle
    problem = betas, pose, trans, target
    assert_same(by_hand(smpl, *problem), by_autograd(smpl, *problem), 1e-10)


def test_exact_fit_has_a_finite_gradient(smpl):
    zeros = torch.zeros(1, 10), torch.zeros(1, 22, 3), torch.zeros(1, 3)
    objective = MeshDistance(smpl)
    shapes = objective.shapes(zeros[0])
    gradient = objective.to(shapes.vertices).gradient(shapes, *zeros[1:])
    assert gradient.distance.item() < 1e-4
    assert torch.isfinite(gradient.pose).all()
