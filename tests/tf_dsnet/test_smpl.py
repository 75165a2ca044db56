"""SMPL in TensorFlow against the float64 reference, at ordinary angles and at 0 and pi."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import pose_vertices
from bridge.body.posing import rest_vertices
from dsnet.verify.reference.smpl import unposed_vertices
from tf_dsnet.framework import tf
from tf_dsnet.smpl import KerasSMPL, unpose


@pytest.fixture(scope="module")
def smpl(body) -> KerasSMPL:
    return KerasSMPL(body, tf.float64)


def bodies(seed: int, angle: float | None, count: int = 2, joints: int = 22):
    """Random betas, pose whose every joint turns by `angle` (any when None), trans, offsets."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, joints, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    turns = rng.uniform(0, 1.2, (count, joints, 1)) if angle is None else angle
    return (
        rng.normal(size=(count, 10)),
        axes * turns,
        rng.normal(size=(count, 3)),
        rng.normal(0, 0.02, (count, 6890, 3)),
    )


@pytest.mark.parametrize("joints", [22, 24])
@pytest.mark.parametrize("angle", [None, 0.0, 1e-8, 0.00999, 0.01001, np.pi, 2.5 * np.pi])
def test_vertices_are_the_references(smpl, body, joints, angle):
    arguments = bodies(0, angle, joints=joints)
    np.testing.assert_allclose(smpl(*arguments), pose_vertices(body, *arguments), atol=1e-12)


@pytest.mark.parametrize("angle", [None, 0.0, np.pi])
def test_gradient_along_a_direction(smpl, angle):
    arguments = [tf.constant(argument) for argument in bodies(4, angle, count=1)]
    direction = bodies(5, 1.0, count=1)
    probe = np.random.default_rng(6).normal(size=(1, 6890, 3))

    def value(step: float) -> float:
        moved = [a + step * d for a, d in zip(arguments, direction, strict=True)]
        return float(tf.reduce_sum(probe * smpl(*moved)))

    with tf.GradientTape() as tape:
        tape.watch(arguments)
        total = tf.reduce_sum(probe * smpl(*arguments))
    gradients: Any = tape.gradient(total, arguments)
    slope = sum(float(tf.reduce_sum(g * d)) for g, d in zip(gradients, direction, strict=True))
    assert (value(1e-5) - value(-1e-5)) / 2e-5 == pytest.approx(slope, rel=1e-6)


def test_gradient_in_float32_is_finite_at_zero_and_pi(body):
    smpl = KerasSMPL(body)
    for angle in (0.0, np.pi):
        pose = tf.constant(bodies(7, angle, count=1)[1], tf.float32)
        with tf.GradientTape() as tape:
            tape.watch(pose)
            total = tf.reduce_sum(tf.square(smpl(np.zeros((1, 10)), pose, np.zeros((1, 3)))))
        found: Any = tape.gradient(total, pose)
        gradient = found.numpy()
        assert np.isfinite(gradient).all()
        assert gradient.any()


@pytest.mark.parametrize("angle", [None, 0.0])
def test_unposing_is_the_references_and_inverts_posing(smpl, body, angle):
    betas, pose, trans, offsets = bodies(8, angle)
    posed = smpl(betas, pose, trans, offsets)
    found = unpose(smpl, posed, betas, pose, trans)
    expected = unposed_vertices(body, posed.numpy(), betas, pose, trans)
    np.testing.assert_allclose(found, expected, atol=1e-10)
    np.testing.assert_allclose(found, rest_vertices(body, betas, pose) + offsets, atol=1e-9)


def test_turned_half_round_the_posed_mesh_is_still_explained(smpl):
    betas, pose, trans, _ = bodies(9, np.pi)
    rest = smpl.rest_vertices(betas, pose)
    # A collapsed vertex is kept where KerasSMPL has it, so without offsets nothing may move.
    found = unpose(smpl, smpl(betas, pose, trans), betas, pose, trans)
    np.testing.assert_allclose(found, rest, atol=1e-9)


def test_collapsed_vertices_keep_what_cannot_be_seen(body):
    # Every vertex hangs half on the pelvis, half on a hip that is turned half round.
    weights = np.zeros_like(body.weights)
    weights[:, :2] = 0.5
    smpl = KerasSMPL(dataclasses.replace(body, weights=weights), tf.float64)
    betas, pose, trans = np.zeros((1, 10)), np.zeros((1, 22, 3)), np.zeros((1, 3))
    pose[0, 1, 1] = np.pi
    found = unpose(smpl, smpl(betas, pose, trans) + 0.001, betas, pose, trans)
    # Only the axis of the turn, y, can still be seen in the posed mesh.
    moved = found - smpl.rest_vertices(betas, pose)
    np.testing.assert_allclose(moved[0], np.tile([0.0, 0.001, 0.0], (6890, 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (((2, 9), (2, 22, 3), (2, 3)), "betas"),
        (((2, 10), (2, 69), (2, 3)), "pose"),
        (((2, 10), (2, 23, 3), (2, 3)), "pose"),
        (((2, 10), (2, 22, 3), (1, 3)), "trans"),
        (((2, 10), (2, 22, 3), (2, 3), (2, 3, 6890)), "offsets"),
    ],
)
def test_wrong_shapes_are_refused(smpl, shapes, message):
    with pytest.raises(DsnetError, match=message):
        smpl(*(np.zeros(shape) for shape in shapes))
