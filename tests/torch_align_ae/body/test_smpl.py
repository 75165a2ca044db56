from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from bridge.body import pose_vertices
from bridge.errors import DsnetError
from torch_align_ae import SMPL


def tensors(*arrays, dtype=torch.float64) -> Any:
    return [torch.as_tensor(array, dtype=dtype) for array in arrays]


@pytest.mark.parametrize("joints", [22, 24])
@pytest.mark.parametrize(("dtype", "tolerance_m"), [(torch.float64, 1e-10), (torch.float32, 1e-5)])
def test_matches_the_reference(body, random_bodies, joints, dtype, tolerance_m):
    betas, pose, trans = random_bodies(3, joints)
    offsets = np.random.default_rng(1).normal(0, 0.02, (3, body.vertex_count, 3))
    expected = pose_vertices(body, betas, pose, trans, offsets)
    posed = SMPL(body, dtype)(*tensors(betas, pose, trans, offsets, dtype=dtype))
    assert posed.dtype == dtype
    np.testing.assert_allclose(posed.numpy(), expected, atol=tolerance_m)


def test_dense_pose_blend_shapes_match_the_reference(small_body, random_bodies):
    arguments = random_bodies(4, angle=1.5)
    posed = SMPL(small_body, torch.float64)(*tensors(*arguments))
    np.testing.assert_allclose(posed.numpy(), pose_vertices(small_body, *arguments), atol=1e-12)


def test_gradients_in_every_argument(small_body, random_bodies):
    smpl = SMPL(small_body, torch.float64)
    offsets = np.random.default_rng(1).normal(0, 0.02, (2, 20, 3))
    arguments = tensors(*random_bodies(2, joints=22), offsets)
    assert torch.autograd.gradcheck(smpl, [argument.requires_grad_() for argument in arguments])


def test_gradient_at_zero_rotation_is_finite(body):
    pose = torch.zeros(1, 22, 3, requires_grad=True)
    posed = SMPL(body)(torch.zeros(1, 10), pose, torch.zeros(1, 3))
    (gradient,) = torch.autograd.grad(posed.square().sum(), pose)
    assert torch.isfinite(gradient).all()
    assert gradient.abs().sum() > 0


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (((2, 11), (2, 22, 3), (2, 3)), "betas"),
        (((2, 10), (2, 69), (2, 3)), "pose"),
        (((2, 10), (2, 23, 3), (2, 3)), "pose"),
        (((2, 10), (2, 22, 3), (1, 3)), "trans"),
        (((2, 10), (2, 22, 3), (2, 3), (2, 3, 20)), "offsets"),
    ],
)
def test_wrong_shapes_are_refused(small_body, shapes, message):
    with pytest.raises(DsnetError, match=message):
        SMPL(small_body)(*(torch.zeros(shape) for shape in shapes))
