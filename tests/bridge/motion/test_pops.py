"""Pops: a leg that flips and comes back, a root that leaps; nothing that people do is one."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from bridge.motion import Motion, load_amass_motion, load_motion_file, pack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion_checks import find_pops, motion_warnings
from bridge.motion.sample_files import SAMPLES, sample_path

FPS = 60.0
SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"
RIGHT_HIP, LEFT_SHOULDER = 2, 16


def swaying(frames: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Joint rotations (T, 22, 3) and translations (T, 3) of somebody who sways."""
    time_s = np.arange(frames) / FPS
    pose, trans_m = np.zeros((frames, 22, 3)), np.zeros((frames, 3))
    pose[:, 3, 0] = 0.2 * np.sin(6 * time_s)
    trans_m[:, 0] = 0.1 * np.sin(6 * time_s)
    return pose, trans_m


def motion_of(pose: np.ndarray, trans_m: np.ndarray) -> Motion:
    theta = pack_theta(pose, trans_m)
    return Motion(theta, np.zeros(10), "unknown", FPS, FPS, Path("walk.bvh"))


def pops_of(motion: Motion) -> dict[int, str]:
    return find_pops(motion, pieces_between_cuts(motion.theta))


def test_a_leg_that_flips_and_comes_back_is_one_pop_each_time() -> None:
    pose, trans_m = swaying()
    for frame in (30, 90):
        pose[frame : frame + 3, RIGHT_HIP, 1] = np.radians([60.0, 120.0, 60.0])
    found = motion_of(pose, trans_m)
    assert pops_of(found) == {30: "right_hip", 90: "right_hip"}
    (line,) = motion_warnings(found, pieces_between_cuts(found.theta))
    assert line.startswith("walk.bvh moves faster than anybody can: right_hip at 0.50 s, right_hip")


def test_arms_may_be_faster_than_legs() -> None:
    pose, trans_m = swaying()
    pose[30:, LEFT_SHOULDER, 2] = np.radians(100.0)
    assert pops_of(motion_of(pose, trans_m)) == {}
    pose[30:, LEFT_SHOULDER, 2] = np.radians(140.0)
    assert pops_of(motion_of(pose, trans_m)) == {30: "left_shoulder"}


def test_a_root_that_leaps_sideways_is_one() -> None:
    pose, trans_m = swaying()
    trans_m[40:, 0] += 0.1
    assert pops_of(motion_of(pose, trans_m)) == {39: "root"}
    trans_m[40:, 0] -= 0.08
    assert pops_of(motion_of(pose, trans_m)) == {}


def test_what_lies_on_both_sides_of_a_cut_is_none() -> None:
    pose, trans_m = swaying()
    trans_m[40:, 0] += 2.0
    pose[40:, RIGHT_HIP, 1] = 1.5
    assert pops_of(motion_of(pose, trans_m)) == {}
    for frames in (1, 2):
        assert pops_of(motion_of(pose[:frames], trans_m[:frames])) == {}


@pytest.mark.parametrize("name", SAMPLES)
def test_no_motion_of_ours_has_one(name: str) -> None:
    assert pops_of(load_motion_file(sample_path(name))) == {}


@pytest.mark.licensed
@pytest.mark.skipif(not SAMPLE.is_file(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
@pytest.mark.parametrize("source_fps", [None, 60.0])
def test_a_real_jumping_jack_has_none(source_fps: float | None) -> None:
    assert pops_of(load_amass_motion(SAMPLE, source_fps=source_fps)) == {}
