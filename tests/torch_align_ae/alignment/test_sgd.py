from __future__ import annotations

import numpy as np
import pytest
import torch

from torch_align_ae.alignment import sgd
from torch_align_ae.alignment.mesh_distance import MeshDistance
from torch_align_ae.alignment.sgd import (
    Descent,
    MomentumDescent,
    batches,
    fit_pose,
    fit_shape_and_pose,
    rigid_start,
)


@pytest.fixture(scope="module")
def objective(smpl):
    return MeshDistance(smpl)


def root_mean_square_m(objective, target, *variables):
    posed = objective.smpl(*variables)
    return (posed - objective.restore(target)).square().sum(2).mean().sqrt().item()


def test_recovers_pose_within_the_methods_floor(objective, smpl, motion):
    pose, trans = (part[:2] for part in motion(2))
    betas = torch.zeros(2, 10)
    target = objective.arrange(smpl(betas, pose, trans))
    begin = pose + 0.03, trans + 0.02
    found = fit_pose(objective.shapes(betas), begin, target, 300, Descent())
    assert root_mean_square_m(objective, target, betas, *found) < 0.003
    assert root_mean_square_m(objective, target, betas, *begin) > 0.03
    np.testing.assert_allclose(found[0], pose, atol=0.03)


def test_recovers_shape_within_the_methods_floor(objective, smpl, motion):
    pose, trans = (part[:1] for part in motion(1))
    betas = torch.tensor([[0.6, -0.3, 0, 0, 0, 0, 0, 0, 0, 0]])
    target = objective.arrange(smpl(betas, 0.3 * pose, trans))
    found = fit_shape_and_pose(objective, target, Descent(shape_steps=800))
    assert root_mean_square_m(objective, target, *found) < 0.006
    assert abs(found[0][0, 0] - 0.6) < 0.1


def test_steps_are_torchs_to_the_last_bit():
    generator = torch.Generator().manual_seed(0)
    start = torch.randn(2, 3, 3, generator=generator), torch.randn(2, 4, generator=generator)
    variables = [variable.clone() for variable in start]
    optimizer = torch.optim.SGD(variables, lr=1e-4, momentum=0.9)
    descending = MomentumDescent(Descent(), *start)
    for _ in range(7):
        gradients = [torch.randn(variable.shape, generator=generator) for variable in variables]
        for variable, gradient in zip(variables, gradients, strict=True):
            variable.grad = gradient
        descending.step(torch.zeros(2), *gradients)
        optimizer.step()
    for found, expected in zip(descending.variables, variables, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("iterate", "fitted"), [("closest", [[1.0], [0.0]]), ("last", [[3.0], [3.0]])]
)
def test_each_body_keeps_its_closest_iterate_or_the_last(iterate, fitted):
    descent = Descent(lr=1.0, momentum=0.0, iterate=iterate)
    descending = MomentumDescent(descent, torch.zeros(2, 1))
    for distance in ([3.0, 1.0], [2.0, 5.0], [4.0, torch.nan]):
        descending.step(torch.tensor(distance), -torch.ones(2, 1))
    assert descending.variables[0].tolist() == [[3.0], [3.0]]
    assert descending.fitted()[0].tolist() == fitted


def test_rigid_start_finds_a_person_who_looks_the_other_way(objective, smpl):
    pose, trans = torch.zeros(2, 22, 3), torch.tensor([[0.3, 1.0, -2.0], [0.0, 0.0, 0.0]])
    pose[0, 0] = torch.tensor([0.1, 3.1, 0.0])
    pose[1, 0] = torch.tensor([0.0, -1.5, 0.4])
    betas = torch.zeros(2, 10)
    found = rigid_start(objective.shapes(betas), objective.arrange(smpl(betas, pose, trans)))
    np.testing.assert_allclose(found[0], pose, atol=0.01)
    np.testing.assert_allclose(found[1], trans, atol=0.01)


@pytest.mark.parametrize(
    ("count", "cores", "sizes"),
    [
        (1, 16, [1]),
        (3, 2, [2, 1]),
        (67, 2, [34, 33]),
        (129, 2, [33, 32, 32, 32]),
        (40, 4, [10] * 4),
        (40, 16, [5] * 8),
    ],
)
def test_as_many_batches_as_keep_all_cores_busy(monkeypatch, count, cores, sizes):
    monkeypatch.setattr(sgd, "usable_cores", lambda: cores)
    found = batches(count)
    assert [len(rows) for rows in found] == sizes
    assert [row for rows in found for row in rows] == list(range(count))


def test_a_row_is_the_same_in_every_batch_of_four_or_more(objective, smpl, motion):
    pose, trans = (part[:9] for part in motion(9))
    betas = torch.zeros(9, 10)
    target = objective.arrange(smpl(betas, pose, trans))

    def fitted(rows):
        start = 0.9 * pose[rows], trans[rows]
        return fit_pose(objective.shapes(betas[rows]), start, target[rows], 20, Descent())

    all_at_once, four, five = fitted(list(range(9))), fitted([0, 1, 2, 3]), fitted([4, 5, 6, 7, 8])
    for whole, *parts in zip(all_at_once, four, five, strict=True):
        torch.testing.assert_close(torch.cat(parts), whole, rtol=0, atol=0)
