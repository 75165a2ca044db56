"""PyTorch's own SGD on the SMPL module finds the iterates of the descent written out by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from torch_align_ae.alignment import sgd, stock_sgd
from torch_align_ae.alignment.mesh_distance import MeshDistance

FEW = sgd.Descent(shape_steps=30)


@pytest.fixture(scope="module")
def bodies(smpl64, lively):
    """Objective, shapes and meshes of three bodies, and a start near their poses."""
    objective = MeshDistance(smpl64)
    pose, trans = lively(3, dtype=torch.float64)
    betas = torch.linspace(-1.5, 1.5, 30, dtype=torch.float64).reshape(3, 10)
    target = objective.arrange(smpl64(betas, pose, trans))
    return objective, betas, target, (pose + 0.05, trans - 0.02)


def largest_difference(found, expected):
    return max(float((one - other).abs().max()) for one, other in zip(found, expected, strict=True))


@pytest.mark.parametrize("iterate", ["closest", "last"])
def test_poses_are_those_of_the_fast_descent_and_of_no_other(bodies, iterate):
    objective, betas, target, start = bodies
    fitted = objective.shapes(betas), start, target, 40
    descent = replace(FEW, iterate=iterate)
    fast = sgd.fit_pose(*fitted, descent)
    stock = sgd.fit_pose(*fitted, replace(descent, stock=True))
    assert largest_difference(stock, fast) < 1e-11 < largest_difference(stock, start)
    other = stock_sgd.fit_pose(*fitted, replace(descent, momentum=0.89))
    assert largest_difference(other, fast) > 1e-4


def test_without_a_step_the_start_is_the_closest(bodies):
    objective, betas, target, start = bodies
    found = stock_sgd.fit_pose(objective.shapes(betas), start, target, 0, FEW)
    assert largest_difference(found, start) == 0


def test_past_the_optimum_the_closest_iterate_stays(bodies):
    """The unsquared norm's gradient does not vanish, so steps from the optimum lead away."""
    objective, betas, target, (pose, trans) = bodies
    optimum = pose - 0.05, trans + 0.02
    found = stock_sgd.fit_pose(objective.shapes(betas), optimum, target, 5, FEW)
    fast = sgd.fit_pose(objective.shapes(betas), optimum, target, 5, FEW)
    assert largest_difference(found, optimum) == largest_difference(fast, optimum) == 0
