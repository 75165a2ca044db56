from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from torch_align_ae.body.rotations import (
    axis_angle_to_matrix,
    matrix_to_axis_angle,
)

# Around zero, around the switch to the series, around pi and beyond.
ANGLES = st.one_of(
    st.floats(0, 2e-2),
    st.floats(np.pi - 1e-6, np.pi + 1e-6),
    st.floats(0, 2 * np.pi),
)
AXES = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1)


def axis_angle(axis, angle):
    return torch.as_tensor(np.array(axis) / np.linalg.norm(axis) * angle)


@given(AXES, ANGLES)
def test_matches_scipy(axis, angle):
    vector = axis_angle(axis, angle)
    expected = Rotation.from_rotvec(vector.numpy()).as_matrix()
    np.testing.assert_allclose(axis_angle_to_matrix(vector).numpy(), expected, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 9.9e-3, 1.01e-2, 1.0, np.pi - 1e-9, np.pi, 6.2])
def test_gradient(angle):
    vector = axis_angle((0.3, -0.5, 0.8), angle).requires_grad_()
    assert torch.autograd.gradcheck(axis_angle_to_matrix, vector)


def test_gradient_at_zero_in_float32():
    vector = torch.zeros(2, 3, requires_grad=True)
    (gradient,) = torch.autograd.grad(axis_angle_to_matrix(vector)[..., 2, 1].sum(), vector)
    np.testing.assert_allclose(gradient, [[1, 0, 0]] * 2, atol=1e-7)


@given(AXES, st.one_of(st.floats(0, 1e-6), st.floats(0, np.pi), st.floats(3.14159, np.pi)))
def test_matrix_to_axis_angle_inverts(axis, angle):
    matrix = axis_angle_to_matrix(axis_angle(axis, angle))
    found = matrix_to_axis_angle(matrix)
    np.testing.assert_allclose(axis_angle_to_matrix(found), matrix, atol=1e-12)
    assert found.norm() <= np.pi + 1e-12
    expected = axis_angle(axis, angle)
    if angle < 3.1:
        np.testing.assert_allclose(found, expected, atol=1e-12)
