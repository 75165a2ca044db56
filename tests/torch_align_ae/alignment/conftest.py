from __future__ import annotations

import numpy as np
import pytest
import torch

from bridge.meshes.dyna_files import write_dyna
from tests.one_thread import one_thread as one_thread
from torch_align_ae import SMPL
from torch_align_ae.alignment.skin_sample import Pose, SkinSample
from torch_align_ae.body.rotations import axis_angle_to_matrix


@pytest.fixture(scope="session")
def smpl(body):
    return SMPL(body)


@pytest.fixture(scope="session")
def motion():
    """Make a slow motion of `length` frames: pose (T, 22, 3) and trans (T, 3)."""

    def make(length: int, phase: float = 0.0):
        wave = np.sin(np.arange(length) * 0.1 + phase)
        pose, trans = np.zeros((length, 22, 3)), np.zeros((length, 3))
        pose[:, 0, 1] = 0.2 * wave
        pose[:, [16, 17], 2] = np.array([-1.0, 1.0]) * (1.0 + 0.2 * wave[:, None])
        pose[:, 4, 0] = 0.2 + 0.2 * wave
        trans[:, 1] = 0.05 * wave
        return torch.tensor(pose).float(), torch.tensor(trans).float()

    return make


@pytest.fixture(scope="session")
def corpus(tmp_path_factory, body, smpl, motion):
    """A body model file, a Dyna file with two subjects and three sequences, and the truth."""
    folder = tmp_path_factory.mktemp("meshes")
    body.save_smpl_npz(folder / "SMPL_FEMALE.npz")
    truth = {}
    with write_dyna(folder / "dyna.h5", body.faces) as add:
        for number, (name, length) in enumerate(
            {"50004_hips": 35, "50004_one_leg_jump": 3, "50020_hips": 20}.items()
        ):
            betas = torch.zeros(length, 10)
            betas[:, 0] = 0.5 if name.startswith("50004") else -0.5
            pose, trans = motion(length, phase=number)
            ripple = 0.002 * torch.sin(torch.arange(length) * 0.5 + number)[:, None, None]
            offsets = ripple.expand(-1, 6890, 3)
            add(name, smpl(betas, pose, trans, offsets).numpy())
            truth[name] = betas[0], pose, trans
    return folder, truth


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
