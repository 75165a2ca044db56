"""Laps laid one after another are the motion that goes on; what does not close is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.motion import pack_theta, unpack_theta
from dsnet.prediction.loops import close_loop
from tests.forged.cyclic import circling

LAP = 40
# The circle is about the pelvis where theta's translation puts a root joint at rest in 0.
AT_ORIGIN = np.zeros(3)


def assert_same_motion(found, expected, atol):
    (pose, trans), (other, places) = unpack_theta(found), unpack_theta(expected)
    np.testing.assert_allclose(trans, places, atol=atol)
    one, two = (Rotation.from_rotvec(p.reshape(-1, 3)) for p in (pose, other))
    np.testing.assert_allclose((one.inv() * two).magnitude(), 0.0, atol=atol)


@pytest.mark.parametrize("turn_rad", [0.5, -1.5, 1e-9])
def test_laps_go_on_as_the_motion_does(turn_rad):
    """With the first frame again at the end the map is known exactly."""
    lap = close_loop(circling(LAP + 1, LAP, turn_rad=turn_rad), AT_ORIGIN)
    assert lap.dropped
    assert len(lap.theta) == LAP
    assert_same_motion(lap.repeated(4), circling(4 * LAP, LAP, turn_rad=turn_rad), 1e-6)


def test_without_the_first_frame_again_the_next_step_is_like_its_neighbours():
    lap = close_loop(circling(LAP, LAP), AT_ORIGIN)
    assert not lap.dropped
    assert_same_motion(lap.repeated(3), circling(3 * LAP, LAP), 2e-3)


def test_the_map_is_about_the_bodys_own_root():
    """Translation is not where the pelvis is: it is as far from it as the joint rests from 0."""
    joint = np.array([0.02, 0.3, -0.1])
    pose, places = unpack_theta(circling(4 * LAP, LAP))
    whole = pack_theta(pose, places - joint)
    assert_same_motion(close_loop(whole[: LAP + 1], joint).repeated(4), whole, 1e-6)


def test_a_lap_does_not_climb():
    theta = circling(LAP, LAP)
    theta[:, -2] += np.linspace(0, 0.004, LAP)
    heights = close_loop(theta, AT_ORIGIN).repeated(50)[:, -2]
    np.testing.assert_allclose(heights, np.tile(theta[:, -2], 50), atol=1e-12)


@pytest.mark.parametrize("frames", [LAP // 4, LAP // 2, 3 * LAP // 4, LAP - 4, LAP + 4])
def test_part_of_a_lap_is_refused(frames):
    """Half a lap, too, where every joint is near its first place and goes the other way."""
    with pytest.raises(DsnetError, match=r"--loop .* whose \w+ jerks by \d.*at most 2\.0"):
        close_loop(circling(frames, LAP), AT_ORIGIN)


def test_the_joint_that_is_off_is_named():
    pose, trans = unpack_theta(circling(LAP, LAP))
    pose[:, 4, 0] += np.linspace(0, np.radians(30), LAP)
    with pytest.raises(DsnetError, match=r"left_knee jerks by 30\.8 degrees"):
        close_loop(pack_theta(pose, trans), AT_ORIGIN)


def test_a_motion_that_jerks_may_jerk_over_the_seam():
    pose, trans = unpack_theta(circling(LAP, LAP))
    pose[:, 4, 0] += np.radians(10) * (np.arange(LAP) // 2 % 2)
    assert len(close_loop(pack_theta(pose, trans), AT_ORIGIN).theta) == LAP


def test_a_root_that_has_sunk_is_refused():
    theta = circling(LAP, LAP)
    theta[:, -2] -= np.linspace(0, 0.1, LAP)
    with pytest.raises(DsnetError, match=r"root jerks by 1\d\.\d cm"):
        close_loop(theta, AT_ORIGIN)


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_too_few_frames_are_refused(frames):
    with pytest.raises(DsnetError, match=f"motion of {frames} frames"):
        close_loop(np.zeros((frames, 69)), AT_ORIGIN)


def test_standing_still_is_a_lap():
    lap = close_loop(np.zeros((10, 69)), AT_ORIGIN)
    assert not lap.repeated(3).any()
