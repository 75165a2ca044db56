from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torch_align_ae.alignment.paper.bones import JointTree
from torch_align_ae.alignment.paper.objective import MeshDistance
from torch_align_ae.body.kinematics import bone_transforms, tree_levels
from torch_align_ae.body.rotations import axial_vector, axis_angle_to_matrix


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
    expected = bone_transforms(rotations, joints, tree_levels(parents), trans)
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
    np.testing.assert_allclose(bones.jacobian[..., 0, 0], axial_vector(spin).T / 2, atol=1e-12)
    np.testing.assert_allclose(bones.pose_features[..., 0, 0], rotation - torch.eye(3), atol=1e-12)


@pytest.fixture(scope="module")
def objective(smpl):
    return MeshDistance(smpl)


def test_patches_hold_every_vertex_once(objective, smpl):
    vertices = torch.cat([patch.vertices for patch in objective.patches])
    assert sorted(vertices.tolist()) == list(range(smpl.vertex_count))


def test_patches_leave_out_only_zeros(objective, smpl):
    weights = sum(patch.weights.sum() for patch in objective.patches)
    posedirs = sum(patch.posedirs.abs().sum() for patch in objective.patches)
    # The features of the hands, which never move in theta, are the last 18.
    np.testing.assert_allclose(weights, smpl.vertex_count, rtol=1e-5)
    np.testing.assert_allclose(posedirs, smpl.posedirs[:-18].abs().sum(), rtol=1e-5)


def test_restore_undoes_arrange(objective):
    mesh = torch.randn(2, 6890, 3)
    np.testing.assert_array_equal(objective.restore(objective.arrange(mesh)), mesh)
