"""The work of joints' errors, against what posing and unposing say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.alignment.joint_absorption import CARRIERS, JointLoads, pose_error
from bridge.body import load_body_model, pose_vertices
from bridge.body.posing import rest_vertices
from bridge.motion import pack_theta, unpack_theta
from dsnet.verify.reference.smpl import unposed_vertices

FRAMES = 3


@pytest.fixture(scope="module")
def known():
    """A body, its shape, theta, smooth offsets and posed meshes."""
    body = load_body_model("embedded:female")
    rng = np.random.default_rng(0)
    betas = rng.normal(size=10)
    pose, trans = 0.3 * rng.normal(size=(FRAMES, 22, 3)), rng.normal(size=(FRAMES, 3))
    waves = np.sin(5 * body.v_template[:, 1])[:, None] * rng.normal(size=(FRAMES, 1, 3))
    offsets = 0.01 * waves
    shapes = np.repeat(betas[None], FRAMES, axis=0)
    meshes = pose_vertices(body, shapes, pose, trans, offsets)
    return body, betas, pack_theta(pose, trans), offsets, meshes


def taken(known, theta) -> float:
    """sum (D - D') . D, from the offsets that Eq. 5 finds with `theta`."""
    body, betas, _, offsets, meshes = known
    shapes = np.repeat(betas[None], FRAMES, axis=0)
    pose, trans = unpack_theta(theta)
    unposed = unposed_vertices(body, meshes, shapes, pose, trans)
    return float(np.vdot(offsets - (unposed - rest_vertices(body, shapes, pose)), offsets))


def turned(theta, errors, shift_m=0.0):
    """`theta` with each joint turned by `errors` (22, 3) radians in its parent's frame."""
    pose, trans = unpack_theta(theta)
    turns = Rotation.from_rotvec(np.tile(errors, (FRAMES, 1))) * Rotation.from_rotvec(
        pose.reshape(-1, 3)
    )
    return pack_theta(turns.as_rotvec().reshape(pose.shape), trans + shift_m)


@pytest.mark.parametrize("joint", ["pelvis", "spine2", "left_knee", "right_shoulder"])
def test_one_joints_error_takes_what_unposing_misses(known, joint):
    errors = np.zeros((22, 3))
    errors[CARRIERS.index(joint)] = [1e-4, -2e-4, 1e-4]
    theta = turned(known[2], errors)
    work = JointLoads.of(*known).work(theta)
    np.testing.assert_allclose(work[CARRIERS.index(joint)], work.sum(), rtol=1e-9)
    # To first order in the error, and without the pose blend shapes' part.
    np.testing.assert_allclose(work.sum(), taken(known, theta), rtol=0.05)


def test_the_translations_work_is_exact(known):
    theta = turned(known[2], np.zeros((22, 3)), shift_m=0.02)
    work = JointLoads.of(*known).work(theta)
    np.testing.assert_allclose(work[-1], taken(known, theta), rtol=1e-9)
    np.testing.assert_allclose(work[:-1], 0.0, atol=1e-12)


def test_all_carriers_together_take_what_the_pose_absorbs(known):
    errors = 1e-3 * np.random.default_rng(1).normal(size=(22, 3))
    theta = turned(known[2], errors, shift_m=0.001)
    work = JointLoads.of(*known).work(theta)
    np.testing.assert_allclose(work.sum(), taken(known, theta), rtol=0.02)


def test_pose_error_is_the_turn_in_the_parents_frame(known):
    errors = 0.5 * np.random.default_rng(2).normal(size=(22, 3))
    turn, shift = pose_error(turned(known[2], errors, shift_m=0.5), known[2])
    np.testing.assert_allclose(turn, np.repeat(errors[None], FRAMES, axis=0), atol=1e-12)
    np.testing.assert_allclose(shift, 0.5)
