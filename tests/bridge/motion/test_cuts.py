"""Cuts are found where no body can have moved, and nothing is interpolated across them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.motion import Motion, load_motion, pack_theta, unpack_theta
from bridge.motion.cuts import CUT_M, find_cuts, frames_of_rest_pose, is_cut, turns_rad
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import read_motion_file
from bridge.motion.readers.amass import SAMPLES, sample_path
from tests.forged.amass import load_as_it_lies, save, smplh
from tests.forged.bvh import Skeleton, text, world_of
from tests.forged.lively import lively
from tests.forged.swaying import swaying


def still(frames: int = 40) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((frames, 22, 3)), np.zeros((frames, 3))


def cuts_of(pose: np.ndarray, trans_m: np.ndarray) -> list[int]:
    """The first frame of each piece but the first."""
    return [*find_cuts(pack_theta(pose, trans_m))]


@given(seed=st.integers(0, 10**6), angle_deg=st.floats(0, 180))
def test_a_turn_is_the_angle_between(seed, angle_deg):
    rng = np.random.default_rng(seed)
    reference = Rotation.random(2, rng)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(angle_deg) * axis / np.linalg.norm(axis))
    pair = ((reference * turn).as_rotvec()[None], reference.as_rotvec()[None])
    np.testing.assert_allclose(np.degrees(turns_rad(*pair)), angle_deg, atol=1e-5)


@pytest.mark.parametrize("joint", [0, 17])
@pytest.mark.parametrize("about", [np.eye(3)[0], np.eye(3)[2]])
def test_a_joint_turned_round_is_a_cut(joint, about):
    pose, trans = still()
    pose[:, joint] = [0.3, -0.2, 0.1]
    pose[20:, joint] = np.pi * about
    assert cuts_of(pose, trans) == [20]


def test_the_same_rotation_written_otherwise_is_no_cut():
    pose, trans = still()
    pose[:, 3] = [0.0, 3.0, 0.0]
    pose[10:, 3] = [0.0, 3.0 - 2 * np.pi, 0.0]
    assert cuts_of(pose, trans) == []


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
def test_the_fastest_people_are_not_cut(fps):
    """Six turns a second, and a sprint of 12.5 m/s."""
    times_s = np.arange(60) / fps
    pose, trans = still(60)
    pose[:, 0, 1] = 2 * np.pi * 6 * times_s
    trans[:, 0] = 12.5 * times_s
    assert cuts_of(pose, trans) == []


def test_long_motions_are_looked_at_in_parts(monkeypatch):
    pose, trans = still(50)
    pose[[10, 20, 21, 49], 4, 2] = np.pi
    whole = cuts_of(pose, trans)
    monkeypatch.setattr("bridge.motion.cuts._FRAMES_AT_ONCE", 10)
    assert cuts_of(pose, trans) == whole == [10, 11, 20, 22, 49]


def jumping() -> Motion:
    """40 frames that jump at 12, and at 30 by just as much as is a cut."""
    pose, trans_m = still()
    trans_m[12:, 2] += 1.0
    trans_m[30:, 0] += 0.5
    return Motion(pack_theta(pose, trans_m), np.zeros(10), "unknown", 60.0, 60.0, Path("a.npz"))


def test_cuts_stay_where_the_motion_is_moved() -> None:
    motion = jumping()
    assert motion.pieces == [slice(0, 12), slice(12, 30), slice(30, 40)]
    nearer = motion.moved(0.9 * motion.trans_m)
    assert nearer.cuts == replace(nearer, betas=np.ones(10)).cuts == motion.cuts == (12, 30)
    assert replace(motion, theta=nearer.theta.copy()).cuts == (12,)


@pytest.mark.parametrize(
    ("chosen", "cuts"),
    [
        (slice(12), ()),
        (slice(12, None), (18,)),
        (slice(20, 35), (10,)),
        (slice(None, None, 4), (3, 8)),
        (np.array([0, 31, 32]), (1,)),
    ],
)
def test_some_frames_have_their_cuts(chosen: slice, cuts: tuple[int, ...]) -> None:
    some = jumping().frames(chosen)
    assert some.cuts == cuts
    assert [len(some.theta[piece]) > 0 for piece in some.pieces] == [True] * (len(cuts) + 1)


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
    motion = load_as_it_lies(path)

    pose, trans_m = unpack_theta(motion.theta)
    expected_s = np.arange(len(pose)) / 60
    after = expected_s >= cut / rate - 1e-6
    np.testing.assert_allclose(trans_m[:, 0], expected_s + 2.0 * after, atol=1e-9)
    np.testing.assert_allclose(pose[:, 0, 1], np.pi * after, atol=1e-9)
    np.testing.assert_allclose(pose[:, 16, 0], 2 * expected_s, atol=1e-9)
    assert cuts_of(pose, trans_m) == [int(after.argmax())]


def walked(path: Path, rate: float, jumps_m: dict[int, float]) -> Motion:
    """A second of a walk backwards at 1 m/s, with jumps at some of the file's frames."""
    trans = np.zeros((int(rate) + 1, 3))
    trans[:, 0] = -np.arange(len(trans)) / rate
    for frame, jump_m in jumps_m.items():
        trans[frame:, 0] += jump_m + 1 / rate
    arrays = smplh(len(trans), rate)
    return load_as_it_lies(save(path, arrays, poses=np.zeros((len(trans), 156)), trans=trans))


def test_what_is_a_cut_in_the_file_or_at_the_lower_rate_is_one(tmp_path):
    motion = walked(tmp_path / "a.npz", 100.0, {41: 0.501})
    assert motion.cuts == (25,)
    assert motion.theta[25, -3] - motion.theta[24, -3] < CUT_M
    assert walked(tmp_path / "b.npz", 240.0, dict.fromkeys((117, 118, 119), 0.2)).cuts == (30,)


def test_a_frame_astray_between_two_samples_is_gone(tmp_path):
    poses = np.zeros((121, 156))
    poses[51, 1] = np.pi
    path = save(tmp_path / "astray.npz", smplh(121, 120.0), poses=poses, trans=np.zeros((121, 3)))
    motion = load_as_it_lies(path)
    np.testing.assert_allclose(motion.theta, np.zeros((61, 69)), atol=1e-12)
    assert motion.dmpls is not None
    assert motion.dmpls.shape == (61, 8)
    assert read_motion_file(path).cuts == (51, 52)
    assert motion.cuts == ()


def test_a_cut_between_two_poses():
    pose = swaying(np.zeros(3))
    other = pose.copy()
    other[1, 66] += 0.51
    other[2, 9:12] = pose[2, 9:12] + [0, 0, 2.7]
    assert is_cut(pose, other).tolist() == [False, True, True]


REST_M = shaped_joints(load_body_model("embedded:female"), np.zeros((1, 10)))[0]
HANGING = np.radians(80.0)


def arms(angles_rad: np.ndarray) -> np.ndarray:
    """(T, 22, 3) a body whose arms hang down by so much from a T, and that sways a little."""
    pose = np.zeros((len(angles_rad), 22, 3))
    pose[:, 16, 2], pose[:, 17, 2] = -angles_rad, angles_rad
    pose[:, 3, 0] = 0.1 * np.sin(np.arange(len(angles_rad)) / 20)
    return pose


@pytest.mark.parametrize(("fps", "falling"), [(120.0, 4), (120.0, 1), (60.0, 2), (30.0, 1)])
def test_a_rest_pose_is_left_out_with_the_way_from_it(fps: float, falling: int) -> None:
    pose = arms(np.minimum(np.arange(60) / falling, 1.0) * HANGING)
    assert frames_of_rest_pose(pose, fps) == falling
    assert frames_of_rest_pose(pose[falling:], fps) == 0


def test_what_people_do_is_whole() -> None:
    """Neither motions of ours nor a kick that begins at 1,200 degrees a second leap so."""
    for name in SAMPLES:
        stored = read_motion_file(sample_path(name))
        assert frames_of_rest_pose(stored.pose, stored.fps) == 0, name
    assert frames_of_rest_pose(arms(np.radians(1200 / 60) * np.arange(6)), 60.0) == 0
    assert frames_of_rest_pose(unpack_theta(lively(60))[0], 60.0) == 0


def test_a_leap_later_on_is_none_and_two_frames_stay() -> None:
    pose = arms(np.where(np.arange(60) < 30, 0.0, HANGING))
    assert frames_of_rest_pose(pose, 60.0) == 0
    for frames in (1, 2):
        assert frames_of_rest_pose(pose[30 - frames // 2 :][:frames], 60.0) == 0
    assert frames_of_rest_pose(arms(np.array([0.0, 1.4, 0.0])), 60.0) == 1


def test_a_bvh_begins_with_its_motion_and_says_so(tmp_path: Path) -> None:
    still = np.tile([0.0, 1.0, 0.0], (60, 1))
    names = Skeleton(SMPL_JOINT_NAMES, SMPL_PARENTS, REST_M)
    paths = tmp_path / "whole.bvh", tmp_path / "cut.bvh"
    pose = arms(np.where(np.arange(60) < 1, 0.0, HANGING))
    for path, first in zip(paths, (0, 1), strict=True):
        path.write_text(text(names, world_of(pose[first:]), still[first:]))
    whole, cut = map(load_motion, paths)
    np.testing.assert_allclose(whole.theta, cut.theta, atol=1e-9)
    assert (whole.rest_pose_frames, cut.rest_pose_frames) == (1, 0)
    (line,) = motion_warnings(whole)
    assert "whole.bvh: the motion begins after frame 1 of the file" in line
    assert motion_warnings(cut) == []
