"""SMPL's gradient by forces and torques against central differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData, load_body_model, pose_vertices
from bridge.verify.reference import smpl

ARGUMENTS = ("betas", "pose", "trans", "offsets")


@pytest.fixture(scope="module")
def body() -> BodyModelData:
    return load_body_model("embedded:female")


def draw(joints: int, angle: float, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(2, joints, 3))
    return {
        "betas": rng.normal(size=(2, 10)),
        "pose": angle * axis / np.linalg.norm(axis, axis=-1, keepdims=True),
        "trans": rng.normal(size=(2, 3)),
        "offsets": rng.normal(scale=0.01, size=(2, 6890, 3)),
    }


@pytest.mark.parametrize(("joints", "angle"), [(24, 0.7), (22, np.pi), (24, 1e-5)])
def test_gradient(body, joints, angle):
    """Along random directions, one argument at a time; at 0 and at pi as well."""
    given, rng = draw(joints, angle), np.random.default_rng(1)
    probe = rng.normal(size=(2, 6890, 3))
    gradient = smpl.gradient(smpl.Bodies(body, **given), probe)
    for name in ARGUMENTS:
        direction = rng.normal(size=given[name].shape)

        def scalar(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            moved = {**given, name: given[name] + step * direction}
            return float((probe * pose_vertices(body, **moved)).sum())

        found = (scalar(1e-5) - scalar(-1e-5)) / 2e-5
        assert_allclose((gradient[name] * direction).sum(), found, rtol=1e-6, atol=1e-5)


def test_gradient_at_rest_is_finite(body):
    given = draw(24, 0.0)
    gradient = smpl.gradient(smpl.Bodies(body, **given), np.ones((2, 6890, 3)))
    assert all(np.isfinite(array).all() for array in gradient.values())


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-2, 1.0, np.pi, 5.0])
def test_left_jacobian(angle):
    vector = angle * np.array([2.0, -1.0, 2.0]) / 3
    step = 1e-6 * np.array([0.3, 0.5, -0.2])
    after, before = (Rotation.from_rotvec(vector + sign * step) for sign in (1, -1))
    turned = (after * before.inv()).as_rotvec()
    assert_allclose(smpl.left_jacobian(vector) @ (2 * step), turned, rtol=1e-6, atol=1e-15)
