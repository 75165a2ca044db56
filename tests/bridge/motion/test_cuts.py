"""Cuts are found where no body can have moved, and nothing is interpolated across them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.motion import Motion, load_amass_motion, unpack_theta
from bridge.motion.cuts import (
    find_cuts,
    is_cut,
    pieces_between_cuts,
    predict_between_cuts,
)
from bridge.motion.motion_checks import motion_warnings
from tests.forged.amass import save, smplh
from tests.forged.swaying import swaying


def still(frames: int = 40) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((frames, 22, 3)), np.zeros((frames, 3))


def test_a_root_that_is_elsewhere_is_a_cut():
    pose, trans = still()
    trans[12:, 2] += 1.0
    trans[30:, 0] -= 1.0
    assert find_cuts(pose, trans) == [12, 30]


@pytest.mark.parametrize("joint", [0, 17])
@pytest.mark.parametrize("about", [np.eye(3)[0], np.eye(3)[2]])
def test_a_joint_turned_round_is_a_cut(joint, about):
    pose, trans = still()
    pose[:, joint] = [0.3, -0.2, 0.1]
    pose[20:, joint] = np.pi * about
    assert find_cuts(pose, trans) == [20]


def test_one_frame_astray_is_two_cuts():
    pose, trans = still()
    pose[9, 5, 0] = np.pi
    assert find_cuts(pose, trans) == [9, 10]


def test_the_same_rotation_written_otherwise_is_no_cut():
    pose, trans = still()
    pose[:, 3] = [0.0, 3.0, 0.0]
    pose[10:, 3] = [0.0, 3.0 - 2 * np.pi, 0.0]
    assert find_cuts(pose, trans) == []


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_the_fastest_people_are_not_cut(fps):
    """Six turns a second, and a sprint of 12.5 m/s."""
    times_s = np.arange(60) / fps
    pose, trans = still(60)
    pose[:, 0, 1] = 2 * np.pi * 6 * times_s
    trans[:, 0] = 12.5 * times_s
    assert find_cuts(pose, trans) == []


def test_long_motions_are_looked_at_in_parts(monkeypatch):
    pose, trans = still(50)
    pose[[10, 20, 21, 49], 4, 2] = np.pi
    whole = find_cuts(pose, trans)
    monkeypatch.setattr("bridge.motion.cuts._FRAMES_AT_ONCE", 10)
    assert find_cuts(pose, trans) == whole == [10, 11, 20, 22, 49]


@pytest.mark.parametrize("frames", [1, 2])
def test_the_shortest_motions_are_one_piece(frames):
    assert pieces_between_cuts(np.zeros((frames, 69))) == [slice(0, frames)]


def test_each_piece_is_predicted_by_itself():
    theta = np.zeros((10, 69))
    theta[4:, -3] = 2.0
    counted = predict_between_cuts(lambda piece: np.arange(len(piece)), theta)
    np.testing.assert_array_equal(counted, [0, 1, 2, 3, 0, 1, 2, 3, 4, 5])


def test_the_warning_is_one_line_that_names_the_frames():
    starts = [0, 30, 60, 90, 120, 150, 180, 210]
    pieces = [slice(start, start + 30) for start in starts]
    still = Motion(np.zeros((240, 69)), np.zeros(10), "unknown", 60.0, 60.0, Path("a.npz"))
    (said,) = motion_warnings(still, pieces)
    assert "a.npz jumps at frame 30 (0.50 s), 60 (1.00 s)" in said
    assert "150 (2.50 s) and 2 more of its 60 frames a second" in said
    assert "\n" not in said
    assert motion_warnings(still, pieces[:1]) == []


@pytest.mark.parametrize("rate", [30.0, 50.0, 60.0, 100.0, 120.0, 250.0])
def test_resampling_keeps_to_one_side_of_a_cut(tmp_path, rate):
    """A walk at 1 m/s with a raised arm turning is moved by 2 m and turned by 180 degrees."""
    count, cut = int(rate) + 1, int(0.41 * rate)
    times_s = np.arange(count) / rate
    poses, trans = np.zeros((count, 156)), np.zeros((count, 3))
    poses[:, 48] = 2 * times_s
    poses[cut:, 1] = np.pi
    trans[:, 0] = times_s
    trans[cut:, 0] += 2.0
    path = save(tmp_path / "cut.npz", smplh(count, rate), poses=poses, trans=trans)
    motion = load_amass_motion(path, up="z")

    pose, trans_m = unpack_theta(motion.theta)
    expected_s = np.arange(len(pose)) / 60
    after = expected_s >= cut / rate - 1e-6
    np.testing.assert_allclose(trans_m[:, 0], expected_s + 2.0 * after, atol=1e-9)
    np.testing.assert_allclose(pose[:, 0, 1], np.pi * after, atol=1e-9)
    np.testing.assert_allclose(pose[:, 16, 0], 2 * expected_s, atol=1e-9)
    assert find_cuts(pose, trans_m) == [int(after.argmax())]


def test_a_frame_astray_between_two_samples_is_gone(tmp_path):
    poses = np.zeros((121, 156))
    poses[51, 1] = np.pi
    path = save(tmp_path / "astray.npz", smplh(121, 120.0), poses=poses)
    motion = load_amass_motion(path, up="z")
    np.testing.assert_allclose(motion.theta, np.zeros((61, 69)), atol=1e-12)
    assert motion.dmpls is not None
    assert motion.dmpls.shape == (61, 8)


def test_a_cut_between_two_poses():
    pose = swaying(np.zeros(3))
    other = pose.copy()
    other[1, 66] += 0.51
    other[2, 9:12] = pose[2, 9:12] + [0, 0, 2.7]
    assert is_cut(pose, other).tolist() == [False, True, True]
