from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from bridge.body import pose_vertices
from bridge.body.posing import rest_vertices, shaped_joints, shaped_vertices
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


def test_rest_pose_parts_match_the_reference(small_body, random_bodies):
    betas, pose, _ = random_bodies(3)
    smpl = SMPL(small_body, torch.float64)
    vertices = smpl.rest_vertices(*tensors(betas, 0 * pose))
    np.testing.assert_allclose(vertices, shaped_vertices(small_body, betas), atol=1e-12)
    joints = smpl.joints(torch.as_tensor(betas))
    np.testing.assert_allclose(joints, shaped_joints(small_body, betas), atol=1e-12)
    rest = smpl.rest_vertices(*tensors(betas, pose))
    np.testing.assert_allclose(rest, rest_vertices(small_body, betas, pose), atol=1e-12)


def test_zero_arguments_give_the_template(body):
    posed = SMPL(body)(torch.zeros(1, 10), torch.zeros(1, 22, 3), torch.zeros(1, 3))
    np.testing.assert_allclose(posed[0], body.v_template, atol=1e-6)


def test_batch_equals_singles(body, random_bodies):
    smpl = SMPL(body, torch.float64)
    arguments = tensors(*random_bodies(4))
    singles = [smpl(*(argument[i : i + 1] for argument in arguments)) for i in range(4)]
    np.testing.assert_allclose(smpl(*arguments), torch.cat(singles), atol=1e-13)


def test_gradients_in_every_argument(small_body, random_bodies):
    smpl = SMPL(small_body, torch.float64)
    offsets = np.random.default_rng(1).normal(0, 0.02, (2, 20, 3))
    arguments = tensors(*random_bodies(2, joints=22), offsets)
    assert torch.autograd.gradcheck(smpl, [argument.requires_grad_() for argument in arguments])


def test_gradient_along_a_direction_on_the_full_body(body, random_bodies):
    smpl = SMPL(body, torch.float64)
    arguments = tensors(*random_bodies(1, joints=22))
    direction = tensors(*random_bodies(1, joints=22, seed=1))
    weight = torch.as_tensor(np.random.default_rng(2).normal(size=(1, 6890, 3)))

    def value(step):
        moved = [a + step * d for a, d in zip(arguments, direction, strict=True)]
        return (weight * smpl(*moved)).sum().item()

    variables = [argument.requires_grad_() for argument in arguments]
    gradients = torch.autograd.grad((weight * smpl(*variables)).sum(), variables)
    slope = sum((g * d).sum().item() for g, d in zip(gradients, direction, strict=True))
    assert (value(1e-5) - value(-1e-5)) / 2e-5 == pytest.approx(slope, rel=1e-7)


def test_gradient_at_zero_rotation_is_finite(body):
    pose = torch.zeros(1, 22, 3, requires_grad=True)
    posed = SMPL(body)(torch.zeros(1, 10), pose, torch.zeros(1, 3))
    (gradient,) = torch.autograd.grad(posed.square().sum(), pose)
    assert torch.isfinite(gradient).all()
    assert gradient.abs().sum() > 0


def test_matches_smplfitter(body, random_bodies, tmp_path):
    smplfitter = pytest.importorskip("smplfitter.pt")
    body.save_smpl_pkl(tmp_path / "basicmodel_f_lbs_10_207_0_v1.1.0.pkl")
    np.save(tmp_path / "kid_template.npy", body.v_template)
    betas, pose, trans = tensors(*random_bodies(3), dtype=torch.float32)
    peer = smplfitter.BodyModel("smpl", "female", model_root=str(tmp_path), num_betas=10)
    theirs = peer(shape_betas=betas, pose_rotvecs=pose.flatten(1), trans=trans)["vertices"]
    np.testing.assert_allclose(SMPL(body)(betas, pose, trans), theirs, atol=1e-5)


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
