"""Features of motions: known motions have known rates, and place, heading and future are unseen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.systems.kinematics import (
    KINEMATICS_SIZE,
    ROOT_RATES_SIZE,
    changes,
    deviations_from_rest,
    euler_zxy,
    kinematics,
    root_rates,
)
from bridge.motion import pack_theta, unpack_theta
from tests.forged.lively import lively, moved

FPS = 60.0
FRAMES = len(lively())


def turning(joint: int, rad_s: NDArray, start: Rotation) -> NDArray:
    """A body that stands, but for one joint at a constant rate in its own frame."""
    pose = np.zeros((FRAMES, 22, 3))
    steps = Rotation.from_rotvec(np.arange(FRAMES)[:, None] / FPS * rad_s)
    pose[:, joint] = (start * steps).as_rotvec()
    return pack_theta(pose, np.zeros((FRAMES, 3)))


@pytest.mark.parametrize(("joint", "column"), [(0, 6), (1, 12), (5, 24), (21, 72)])
def test_a_constant_turn_has_a_constant_rate_in_every_frame(joint, column):
    rad_s = np.array([3.0, -5.0, 8.0])  # more than a whole turn, through pi
    found = kinematics(turning(joint, rad_s, Rotation.from_rotvec([0.3, 2.0, -0.4])))
    assert found.shape == (FRAMES, KINEMATICS_SIZE) == (FRAMES, 138)
    np.testing.assert_allclose(found[1:, column : column + 3], np.tile(rad_s, (FRAMES - 1, 1)))
    found[:, column : column + 3] = 0.0
    np.testing.assert_allclose(found, 0.0, atol=1e-8)


def test_a_constant_change_of_the_rate_is_the_acceleration():
    seconds = np.arange(FRAMES) / FPS
    pose = np.zeros((FRAMES, 22, 3))
    pose[:, 4, 1] = 0.5 * 7.0 * seconds**2
    found = kinematics(pack_theta(pose, np.zeros((FRAMES, 3))))
    column = 12 + 63 + 3 * 3 + 1  # joint 4 is the fourth below the root
    np.testing.assert_allclose(found[2:, column], 7.0)
    np.testing.assert_array_equal(found[:2, column], 0.0)


def test_the_roots_path_is_seen_in_its_own_frame():
    seconds = np.arange(FRAMES)[:, None] / FPS
    pull = np.array([0.0, -9.81, 0.0])
    trans = np.array([1.0, 2.0, 3.0]) + seconds * [0.5, 4.0, 0.0] + seconds**2 / 2 * pull
    root = Rotation.from_euler("x", 90, degrees=True)  # y up is -z to the root that leans forward
    pose = np.zeros((FRAMES, 22, 3))
    pose[:, 0] = root.as_rotvec()
    found = kinematics(pack_theta(pose, trans))
    expected = np.tile([0.0, 0.0, 9.81], (FRAMES - 2, 1))
    np.testing.assert_allclose(found[2:, 3:6], expected, atol=1e-9)
    velocity = root.inv().apply(np.diff(trans, axis=0) * FPS)
    np.testing.assert_allclose(found[1:, :3], velocity, atol=1e-10)
    np.testing.assert_array_equal(found[0], 0.0)
    np.testing.assert_array_equal(found[1, 3:6], 0.0)


def test_place_and_heading_are_not_told():
    theta = lively()
    other = moved(theta, Rotation.from_euler("y", 2.9), np.array([5.0, 1.0, -3.0]))
    np.testing.assert_allclose(kinematics(other), kinematics(theta), atol=1e-8)
    tilted = moved(theta, Rotation.from_euler("x", 0.5), np.zeros(3))
    np.testing.assert_allclose(kinematics(tilted), kinematics(theta), atol=1e-8)  # no gravity


def test_root_rates_know_the_heading_of_velocities_alone():
    theta = lively()
    found = root_rates(theta)
    assert found.shape == (FRAMES, ROOT_RATES_SIZE) == (FRAMES, 12)
    shifted = root_rates(moved(theta, Rotation.identity(), np.array([5.0, 1.0, 2.0])))
    np.testing.assert_allclose(shifted, found, atol=1e-8)
    turn = Rotation.from_euler("y", 2.9)
    turned = root_rates(moved(theta, turn, np.zeros(3)))
    for linear in (slice(3), slice(3, 6)):
        np.testing.assert_allclose(turned[:, linear], turn.apply(found[:, linear]), atol=1e-8)
        assert np.abs(turned[:, linear] - found[:, linear]).max() > 0.1
    np.testing.assert_allclose(turned[:, 6:], found[:, 6:], atol=1e-8)


def test_root_rates_are_those_of_the_path():
    theta = lively()
    found, trans = root_rates(theta), theta[:, 66:]
    np.testing.assert_allclose(found[1:, :3], np.diff(trans, axis=0) * FPS)
    np.testing.assert_allclose(found[2:, 3:6], np.diff(trans, n=2, axis=0) * FPS**2, atol=1e-9)
    assert not found[0].any()
    assert not found[1, 3:6].any()
    assert not found[1, 9:].any()


def test_a_spin_has_one_rate_past_half_a_turn():
    found = root_rates(turning(0, np.array([0.0, 12.0, 0.0]), Rotation.identity()))
    np.testing.assert_allclose(found[1:, 6:9], np.tile([0.0, 0.0, 12.0], (FRAMES - 1, 1)))


def test_euler_angles_are_scipys():
    turns = Rotation.random(200, random_state=3)
    np.testing.assert_allclose(euler_zxy(turns.as_matrix()), turns.as_euler("zxy"), atol=1e-7)


def test_changes_are_what_rates_amount_to_in_a_tenth_of_a_second():
    theta = lively(8)
    rates, told = kinematics(theta), changes(theta)
    for velocity in (slice(0, 3), slice(6, 9), slice(12, 75)):
        np.testing.assert_allclose(told[:, velocity], 0.1 * rates[:, velocity], rtol=1e-12)
    for acceleration in (slice(3, 6), slice(9, 12), slice(75, 138)):
        np.testing.assert_allclose(told[:, acceleration], 0.01 * rates[:, acceleration], rtol=1e-12)


@pytest.mark.parametrize("features", [kinematics, root_rates, deviations_from_rest])
def test_no_later_frame_is_looked_at(features):
    theta, other = lively(), lively(seed=1)
    for frame in (0, 1, 2, 17):
        mixed = np.concatenate([theta[: frame + 1], other[frame + 1 :]])
        np.testing.assert_array_equal(
            features(mixed)[: frame + 1], features(theta)[: frame + 1], err_msg=str(frame)
        )


def test_deviations_are_those_of_the_joints_below_the_root():
    assert not deviations_from_rest(turning(0, np.ones(3), Rotation.identity())).any()
    theta = turning(21, np.ones(3), Rotation.from_rotvec([0.0, 0.5, 0.0]))
    found = deviations_from_rest(theta).reshape(FRAMES, 21, 3, 3)
    expected = Rotation.from_rotvec(unpack_theta(theta)[0][:, 21]).as_matrix() - np.eye(3)
    np.testing.assert_allclose(found[:, 20], expected, atol=1e-12)
    assert not found[:, :20].any()


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_motions_have_features_too(frames):
    assert kinematics(lively(frames)).shape == (frames, 138)
    assert root_rates(lively(frames)).shape == (frames, 12)
