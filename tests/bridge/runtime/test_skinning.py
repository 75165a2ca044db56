"""The fast posing of one body is the obvious one."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.runtime.skinning import BodySkin, ShapedBody


@pytest.mark.parametrize("joints", [22, 24])
def test_posed_vertices_are_the_oracles(joints):
    rng = np.random.default_rng(joints)
    body, betas = load_body_model("embedded:female"), rng.normal(size=10)
    pose, trans = rng.normal(0, 0.7, (4, joints, 3)), rng.normal(0, 3, (4, 3))
    pose[0] = 0
    offsets = rng.normal(0, 0.01, (4, body.vertex_count, 3)).astype(np.float32)
    kept = offsets.copy()
    found = ShapedBody(body, betas).pose(pose, trans, offsets)
    expected = pose_vertices(body, np.tile(betas, (4, 1)), pose, trans, offsets)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=5e-6)  # 2^-24 of 10 m, and sums of 24 bones
    np.testing.assert_array_equal(offsets, kept)


def test_several_persons_are_posed_as_each_alone(monkeypatch):
    monkeypatch.setattr("bridge.runtime.skinning._BODIES_AT_ONCE", 4)
    rng = np.random.default_rng(3)
    body, betas = load_body_model("embedded:female"), rng.normal(size=(11, 10))
    pose, trans = rng.normal(0, 0.7, (11, 22, 3)), rng.normal(0, 3, (11, 3))
    offsets = rng.normal(0, 0.01, (11, body.vertex_count, 3)).astype(np.float32)
    kept, skin = offsets.copy(), BodySkin(body)
    found = skin.pose([skin.person(shape) for shape in betas], pose, trans, offsets)
    np.testing.assert_allclose(found, pose_vertices(body, betas, pose, trans, offsets), atol=5e-6)
    np.testing.assert_array_equal(offsets, kept)


def test_a_shape_of_sixteen_numbers_is_refused():
    with pytest.raises(DsnetError, match="betas"):
        ShapedBody(load_body_model("embedded:female"), np.zeros(16))
