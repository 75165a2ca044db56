"""A rest pose before the motion: BVHs of whole libraries begin so, and no recording does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.motion import load_motion_file, unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.lead_in import lead_in_frames
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.motion_file import read_motion_file
from bridge.motion.sample_files import SAMPLES, sample_path
from tests.forged.bvh import Skeleton, text, world_of
from tests.forged.lively import lively

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
    assert lead_in_frames(pose, fps) == falling
    assert lead_in_frames(pose[falling:], fps) == 0


def test_what_people_do_is_whole() -> None:
    """Neither a motion of ours nor a kick that begins at 1,200 degrees a second has a lead-in."""
    for name in SAMPLES:
        stored = read_motion_file(sample_path(name))
        assert lead_in_frames(stored.pose, stored.fps) == 0, name
    assert lead_in_frames(arms(np.radians(1200 / 60) * np.arange(6)), 60.0) == 0
    assert lead_in_frames(unpack_theta(lively(60))[0], 60.0) == 0


def test_a_leap_later_on_is_none_and_two_frames_stay() -> None:
    pose = arms(np.where(np.arange(60) < 30, 0.0, HANGING))
    assert lead_in_frames(pose, 60.0) == 0
    for frames in (1, 2):
        assert lead_in_frames(pose[30 - frames // 2 :][:frames], 60.0) == 0
    assert lead_in_frames(arms(np.array([0.0, 1.4, 0.0])), 60.0) == 1


def test_a_bvh_begins_with_its_motion_and_says_so(tmp_path: Path) -> None:
    still = np.tile([0.0, 1.0, 0.0], (60, 1))
    names = Skeleton(SMPL_JOINT_NAMES, SMPL_PARENTS, REST_M)
    paths = tmp_path / "whole.bvh", tmp_path / "cut.bvh"
    pose = arms(np.where(np.arange(60) < 1, 0.0, HANGING))
    for path, first in zip(paths, (0, 1), strict=True):
        path.write_text(text(names, world_of(pose[first:]), still[first:]))
    whole, cut = map(load_motion_file, paths)
    np.testing.assert_allclose(whole.theta, cut.theta, atol=1e-9)
    assert (whole.lead_in, cut.lead_in) == (1, 0)
    (line,) = motion_warnings(whole, pieces_between_cuts(whole.theta))
    assert "whole.bvh: the motion begins after frame 1 of the file" in line
    assert motion_warnings(cut, pieces_between_cuts(cut.theta)) == []
