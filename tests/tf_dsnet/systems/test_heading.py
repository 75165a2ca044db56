"""Place and heading are taken out, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.systems.heading import ALIGNED_SIZE, heading_aligned, headings
from bridge.exchange.dsnet import join_inputs
from bridge.motion import pack_theta, unpack_theta
from tests.forged.lively import lively, moved

BETAS = np.random.default_rng(8).normal(size=10)


def told(theta):
    return heading_aligned(join_inputs(theta, BETAS))


@pytest.mark.parametrize("turn_rad", [0.4, 3.1, -2.0])
def test_the_same_is_told_wherever_she_is_and_faces(turn_rad):
    theta = lively()
    other = moved(theta, Rotation.from_euler("y", turn_rad), np.array([5.0, 1.0, -3.0]))
    np.testing.assert_allclose(told(other), told(theta), atol=1e-5)
    assert told(theta).shape == (len(theta), ALIGNED_SIZE) == (len(theta), 80)


def test_leaning_is_told():
    tilted = moved(lively(), Rotation.from_euler("x", 0.5), np.zeros(3))
    assert np.abs(told(tilted) - told(lively())).max() > 0.1


def test_the_motion_can_be_had_back_from_its_first_frame():
    theta = np.asarray(lively(), np.float32)
    found = told(theta)
    pose, trans_m = unpack_theta(theta)
    start_rad = headings(Rotation.from_rotvec(pose[0, 0]))
    heading_rad = start_rad + np.cumsum(found[:, 79]) / 6
    facing = Rotation.from_rotvec(np.outer(heading_rad, [0, 1, 0]))
    steps = facing.apply(found[:, 76:79] / 6)
    np.testing.assert_allclose(trans_m[0] + np.cumsum(steps, axis=0), trans_m, atol=1e-5)
    again = found[:, 10:76].reshape(-1, 22, 3).copy()
    again[:, 0] = (facing * Rotation.from_rotvec(again[:, 0])).as_rotvec()
    np.testing.assert_allclose(again, pose, atol=1e-5)
    np.testing.assert_allclose(found[:, :10], np.tile(BETAS, (len(theta), 1)), rtol=1e-6)


def test_whole_turns_are_steady():
    seconds = np.arange(120) / 60
    pose = np.zeros((120, 22, 3))
    lying = Rotation.from_euler("x", 90, degrees=True)
    pose[:, 0] = (Rotation.from_euler("y", 9.0 * seconds) * lying).as_rotvec()
    found = told(pack_theta(pose, np.zeros((120, 3))))
    np.testing.assert_allclose(found[1:, 79], 0.9, atol=1e-6)
    np.testing.assert_allclose(found[:, 10:13], np.tile(lying.as_rotvec(), (120, 1)), atol=1e-6)


def test_no_later_frame_is_looked_at():
    one, other = lively(), lively(seed=1)
    mixed = np.concatenate([one[:18], other[18:]])
    np.testing.assert_allclose(told(mixed)[:18], told(one)[:18], atol=1e-12)
