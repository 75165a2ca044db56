"""SMPL against the body model's other float64 posing, its gradient against central differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bridge.body import pose_vertices
from bridge.body.posing import joint_rotations
from dsnet.verify.reference import smpl

ARGUMENTS = ("betas", "pose", "trans", "offsets")


def draw(joints: int, angle: float, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(2, joints, 3))
    return {
        "betas": rng.normal(size=(2, 10)),
        "pose": angle * axis / np.linalg.norm(axis, axis=-1, keepdims=True),
        "trans": rng.normal(size=(2, 3)),
        "offsets": rng.normal(scale=0.01, size=(2, 6890, 3)),
    }


@pytest.mark.parametrize(("joints", "angle"), [(24, 0.7), (22, np.pi), (24, 1e-5), (24, 0.0)])
def test_gradient(body, joints, angle):
    """Along random directions, one argument at a time; at 0 and at pi as well."""
    given, rng = draw(joints, angle), np.random.default_rng(1)
    probe = rng.normal(size=(2, 6890, 3))
    gradient = smpl.gradient(body, given, probe)
    for name in ARGUMENTS:
        direction = rng.normal(size=given[name].shape)

        def scalar(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            moved = {**given, name: given[name] + step * direction}
            return float((probe * pose_vertices(body, **moved)).sum())

        found = (scalar(1e-5) - scalar(-1e-5)) / 2e-5
        assert_allclose((gradient[name] * direction).sum(), found, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize(("joints", "angle"), [(24, 0.7), (24, np.pi), (22, 11.0), (24, 0.0)])
def test_vertices(body, joints, angle):
    """By formulas of their own: of rotations, of bones, and of what is blended."""
    given = draw(joints, angle)
    assert_allclose(smpl.rotations(given["pose"]), joint_rotations(body, given["pose"]), atol=1e-14)
    assert_allclose(smpl.posed_vertices(body, **given), pose_vertices(body, **given), atol=1e-13)
    few = smpl.posed_vertices(body, **{**given, "betas": given["betas"][:1]})
    assert_allclose(few[0], pose_vertices(body, **given)[0], atol=1e-13)
