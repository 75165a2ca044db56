from __future__ import annotations

import pytest
import torch

from torch_align_ae import SMPL
from torch_align_ae.alignment.robust.sample import Pose, SkinSample
from torch_align_ae.body.rotations import axis_angle_to_matrix


@pytest.fixture(scope="session")
def smpl64(body):
    return SMPL(body, torch.float64)


@pytest.fixture(scope="session")
def sample(smpl):
    return SkinSample(smpl, 500)


@pytest.fixture(scope="session")
def sample64(smpl64):
    return SkinSample(smpl64, 200)


@pytest.fixture(scope="session")
def betas():
    return torch.tensor([0.7, -1.1, 0.4, 0.2, -0.6, 0.3, 0.1, -0.2, 0.5, -0.4])


@pytest.fixture(scope="session")
def lively():
    """Make `count` poses with bent limbs, turned trunks and places in the room."""

    def make(count: int, seed: int = 0, dtype: torch.dtype = torch.float32):
        generator = torch.Generator().manual_seed(seed)
        pose = 0.35 * torch.randn(count, 22, 3, generator=generator, dtype=dtype)
        pose[:, 0] *= 4
        return pose, torch.randn(count, 3, generator=generator, dtype=dtype)

    return make


@pytest.fixture(scope="session")
def as_pose():
    return lambda pose, trans: Pose(axis_angle_to_matrix(pose), trans)
