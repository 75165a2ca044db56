"""Posing by matrix products is the obvious one."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.body.posing import Smpl


@pytest.mark.parametrize("joints", [22, 24])
def test_posed_vertices_are_the_oracles(joints):
    rng = np.random.default_rng(joints)
    body, betas = load_body_model("embedded:female"), rng.normal(size=10)
    pose, trans = rng.normal(0, 0.7, (4, joints, 3)), rng.normal(0, 3, (4, 3))
    pose[0] = 0
    offsets = rng.normal(0, 0.01, (4, body.vertex_count, 3)).astype(np.float32)
    kept = offsets.copy()
    found = Smpl(body).person(betas).pose(pose, trans, offsets)
    expected = pose_vertices(body, np.tile(betas, (4, 1)), pose, trans, offsets)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=5e-6)  # 2^-24 of 10 m, and sums of 24 bones
    np.testing.assert_array_equal(offsets, kept)


def test_several_persons_are_posed_as_each_alone(monkeypatch):
    monkeypatch.setattr("bridge.body.posing._FRAMES_AT_ONCE", 4)
    rng = np.random.default_rng(3)
    body, betas = load_body_model("embedded:female"), rng.normal(size=(11, 10))
    pose, trans = rng.normal(0, 0.7, (11, 22, 3)), rng.normal(0, 3, (11, 3))
    offsets = rng.normal(0, 0.01, (11, body.vertex_count, 3)).astype(np.float32)
    kept, skin = offsets.copy(), Smpl(body)
    found = skin.pose([skin.person(shape) for shape in betas], pose, trans, offsets)
    np.testing.assert_allclose(found, pose_vertices(body, betas, pose, trans, offsets), atol=5e-6)
    np.testing.assert_array_equal(offsets, kept)


def test_some_vertices_are_placed_and_turned_as_among_all():
    rng, chosen = np.random.default_rng(5), np.arange(3, 6890, 50)
    body, betas = load_body_model("embedded:female"), rng.normal(size=10)
    pose, trans = rng.normal(0, 0.7, (70, 22, 3)), rng.normal(0, 3, (70, 3))
    person = Smpl(body, chosen, np.float64).person(betas)
    places, turns = person.skin(pose, trans)
    shapes = np.tile(betas, (70, 1))
    expected = pose_vertices(body, shapes, pose, trans)[:, chosen]
    np.testing.assert_allclose(places, expected, atol=1e-6)  # weights sum to 1 to seven digits
    np.testing.assert_allclose(person.pose(pose, trans), places, atol=1e-12)
    pushed = np.broadcast_to([0.0, 0.0, 1.0], (70, body.vertex_count, 3))
    moved = pose_vertices(body, shapes, pose, trans, pushed)[:, chosen] - expected
    np.testing.assert_allclose(turns[..., 2], moved, atol=1e-6)
    still, unturned = person.skin(np.zeros((1, 22, 3)), np.zeros((1, 3)))
    np.testing.assert_array_equal(unturned[0], np.broadcast_to(np.eye(3), unturned[0].shape))
    np.testing.assert_allclose(still[0].T, person.rest_m, atol=1e-12)


def test_a_shape_of_sixteen_numbers_is_refused():
    with pytest.raises(DsnetError, match="betas"):
        Smpl(load_body_model("embedded:female")).person(np.zeros(16))
