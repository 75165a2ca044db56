from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from torch_align_ae import SMPL
from torch_align_ae.alignment.paper.objective import MeshDistance


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
    by_betas = distance.betas_gradient(gradient)
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
