"""The analytic Jacobian against automatic differentiation of the body model."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dsnet.verify.reference.smpl import rotations

DOUBLE = torch.float64


def left_jacobian(vector: np.ndarray) -> np.ndarray:
    """J (3, 3) with exp(v + dv) = exp(J dv) exp(v) to first order, for a vector v in radians."""
    moved = rotations((vector + 1e-30j * np.eye(3))[:, None])[:, 0]  # a step along each axis
    turns = np.imag(moved) / 1e-30 @ np.real(moved).swapaxes(-1, -2)
    return turns[:, [2, 0, 1], [1, 2, 0]].T


@pytest.fixture(scope="module")
def linearised(sample64, betas, lively, as_pose):
    """Positions (B, 3, N) and Jacobian (B, 23, 3, 3, N) put together from all patches."""
    pose, trans = lively(2, dtype=DOUBLE)
    shaped = sample64.shaped(betas.double())
    frames = shaped.posed(as_pose(pose, trans))
    positions = torch.zeros(2, 3, len(sample64), dtype=DOUBLE)
    jacobian = torch.zeros(2, 23, 3, 3, len(sample64), dtype=DOUBLE)
    for patch in sample64.patches:
        scale = torch.ones(patch.weights.shape[1], dtype=DOUBLE)
        parts = patch.linearise(frames, scale)
        unknowns = torch.cat([patch.joints, torch.tensor([22])])
        positions[:, :, patch.vertices] = parts[0]
        jacobian[:, unknowns, :, :, patch.vertices] = parts[1]
    return positions, jacobian, frames


def test_positions_are_the_body_models(linearised, sample64, smpl64, betas, lively):
    pose, trans = lively(2, dtype=DOUBLE)
    posed = smpl64(betas.double().expand(2, -1), pose, trans)
    torch.testing.assert_close(linearised[0], sample64.select(posed), rtol=0, atol=1e-12)


def test_jacobian_is_the_derivative(linearised, sample64, smpl64, betas, lively):
    pose, trans = lively(2, dtype=DOUBLE)
    _, jacobian, frames = linearised

    def vertices(pose, trans):
        return smpl64(betas.double()[None], pose[None], trans[None])[0][sample64.vertices].T

    by_pose, by_trans = torch.func.jacrev(vertices, argnums=(0, 1))(pose[1], trans[1])
    # A change of an axis-angle vector is a turn in the parent's axes, then in the world's.
    root = torch.eye(3, dtype=DOUBLE)[None]
    above = torch.cat([root, frames.turn[1, list(sample64.parents[1:])]])
    turns = above @ torch.from_numpy(np.stack([left_jacobian(v) for v in pose[1].numpy()]))
    ours = torch.einsum("jixn,jia->xnja", jacobian[1, :22], turns)
    # What the negligible pose blend shapes would add is left out on purpose: 0.1 mm a radian.
    torch.testing.assert_close(ours, by_pose, rtol=0, atol=3e-4)
    exact = (ours - by_pose).abs() < 1e-10
    assert exact.double().mean() > 0.99
    torch.testing.assert_close(jacobian[1, 22].permute(1, 2, 0), by_trans)
