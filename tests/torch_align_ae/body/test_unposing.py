from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.body import load_body_model
from bridge.errors import DsnetError
from torch_align_ae import SMPL, unpose
from torch_align_ae.body import rest_pose_offsets


@pytest.fixture(scope="module")
def smpl():
    return SMPL(load_body_model("embedded:female"), torch.float64)


def bodies(seed, angle):
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape):
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    pose = torch.nn.functional.normalize(draw(2, 22, 3), dim=-1) * angle
    return draw(2, 10), pose, draw(2, 3), 0.02 * draw(2, 6890, 3)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000), st.one_of(st.floats(0, 1e-6), st.floats(0, 1.2)))
def test_unposing_inverts_posing(smpl, seed, angle):
    betas, pose, trans, offsets = bodies(seed, angle)
    posed = smpl(betas, pose, trans, offsets)
    expected = smpl.rest_vertices(betas, pose) + offsets
    np.testing.assert_allclose(unpose(smpl, posed, betas, pose, trans), expected, atol=1e-9)
    found, distances = rest_pose_offsets(smpl, posed, betas, pose, trans)
    np.testing.assert_allclose(found, offsets, atol=1e-9)
    expected = (posed - smpl(betas, pose, trans)).norm(dim=-1)
    np.testing.assert_allclose(distances, expected, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000), st.floats(np.pi - 1e-3, np.pi + 1e-3))
def test_turned_half_round_the_posed_mesh_is_still_explained(smpl, seed, angle):
    betas, pose, trans, _ = bodies(seed, angle)
    posed = smpl(betas, pose, trans)
    rest = smpl.rest_vertices(betas, pose)
    # A collapsed vertex is kept where SMPL has it, so without offsets nothing may move.
    np.testing.assert_allclose(unpose(smpl, posed, betas, pose, trans), rest, atol=1e-9)


def test_a_turned_root_is_inverted_at_pi(smpl):
    betas, pose, trans, offsets = bodies(0, 0.3)
    pose[:, 0] = torch.tensor([0.0, np.pi, 0.0])
    found, _ = rest_pose_offsets(smpl, smpl(betas, pose, trans, offsets), betas, pose, trans)
    np.testing.assert_allclose(found, offsets, atol=1e-9)


def test_collapsed_vertices_get_finite_offsets(small_body):
    # Every vertex hangs half on the pelvis, half on a hip that is turned half round.
    weights = np.zeros((20, 24))
    weights[:, :2] = 0.5
    smpl = SMPL(dataclasses.replace(small_body, weights=weights), torch.float64)
    pose = torch.zeros(1, 22, 3, dtype=torch.float64)
    pose[0, 1, 1] = np.pi
    betas, trans = torch.zeros(1, 10, dtype=torch.float64), torch.zeros(1, 3, dtype=torch.float64)
    noise = torch.full((1, 20, 3), 0.001, dtype=torch.float64)
    found, _ = rest_pose_offsets(smpl, smpl(betas, pose, trans) + noise, betas, pose, trans)
    # Only the axis of the turn, y, can still be seen in the posed mesh.
    np.testing.assert_allclose(found[0], [[0.0, 0.001, 0.0]] * 20, atol=1e-9)


def test_wrong_vertex_count_is_refused(smpl):
    betas, pose, trans, _ = bodies(0, 0.1)
    with pytest.raises(DsnetError, match="6889"):
        unpose(smpl, torch.zeros(2, 6889, 3), betas, pose, trans)
