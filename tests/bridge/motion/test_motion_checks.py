"""A wrong frame rate is told by how she falls; right ones, and what only looks like it, are not."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from bridge.errors import DsnetError
from bridge.motion import Motion, load_motion, pack_theta
from bridge.motion.motion_checks import find_pops, motion_warnings, steepest_fall_g, tremor_mm
from bridge.motion.readers.amass import SAMPLES, sample_path
from tests.forged.amass import load_amass_motion, save, smplh

SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"


def hops_m(fps: float, seconds: float = 2.0) -> np.ndarray:
    """Height of one who flies for 0.3 s of every half second, and stands in between."""
    since_s = np.arange(round(seconds * fps)) / fps % 0.5
    return np.where(since_s < 0.3, 9.81 * since_s * (0.3 - since_s) / 2, 0.0)


@pytest.mark.parametrize("fps", [30.0, 50.0, 60.0, 100.0, 120.0])
@pytest.mark.parametrize("times", [0.5, 1.0, 2.0])
def test_who_flies_falls_with_gravity_and_at_another_rate_with_its_square(fps, times):
    assert steepest_fall_g(hops_m(fps), times * fps) == pytest.approx(times**2)


def test_who_stands_or_was_hardly_seen_does_not_fall():
    assert steepest_fall_g(np.ones(100), 60.0) == 0.0
    assert steepest_fall_g(np.arange(6.0), 60.0) == 0.0


def test_a_trembling_tracker_is_no_fall():
    height_m = 0.9 + 1e-3 * np.random.default_rng(0).standard_normal(6000)
    assert steepest_fall_g(height_m, 120.0) < 1.0


def fall_warning(motion: Motion, pieces: list[slice]) -> str:
    said = motion_warnings(motion, pieces)
    return next((line for line in said if " times gravity " in line), "")


def warning_of(path: Path | str, source_fps: float | None = None) -> str:
    motion = load_motion(path, source_fps)
    return fall_warning(motion, motion.pieces)


@pytest.mark.parametrize("name", SAMPLES)
def test_nothing_is_said_of_our_samples(name):
    motion = load_motion(sample_path(name))
    assert motion_warnings(motion) == []
    assert tremor_mm(motion.trans_m, motion.fps) < 0.2


def test_the_line_names_file_fall_rate_and_remedy():
    said = warning_of("sample:jumping_jacks", 250.0)
    motion = load_amass_motion("sample:jumping_jacks", source_fps=250.0)
    steepest_g = steepest_fall_g(motion.theta[:, 67], 60.0)
    assert f"sample:jumping_jacks falls with {steepest_g:.1f} times gravity" in said
    assert "at its 250 frames a second" in said
    assert "--motion-fps" in said
    fitting = float(said.split("one of some ")[1].split()[0])
    assert warning_of("sample:jumping_jacks", fitting) == ""


def test_a_cut_is_no_fall(tmp_path):
    trans = np.zeros((240, 3))
    trans[:120, 2], trans[120:, 2] = 2.0, 0.9
    save(tmp_path / "cut.npz", smplh(240, 120.0), trans=trans)
    motion = load_amass_motion(tmp_path / "cut.npz")
    assert fall_warning(motion, motion.pieces) == ""
    assert fall_warning(motion, [slice(0, len(motion.theta))]) == ""


def test_a_root_that_leaps_is_no_fall_and_is_named(tmp_path):
    """By 11 cm at 100 frames a second: over a tenth of a second, 4.5 times gravity."""
    trans = np.zeros((251, 3))
    trans[100:, 2] += 0.11
    trans[200:, 2] -= 0.11
    save(tmp_path / "leaps.npz", smplh(251, 100.0), poses=np.zeros((251, 156)), trans=trans)
    said = motion_warnings(load_amass_motion(tmp_path / "leaps.npz", fps=100.0))
    assert not [line for line in said if "gravity" in line]
    assert [
        line for line in said if "faster than anybody can: root at 0.99 s, root at 1.99" in line
    ]


def test_a_root_that_is_lifted_within_some_frames_is_named(tmp_path):
    trans = np.zeros((251, 3))
    trans[100:105, 2], trans[105:, 2] = np.linspace(0.02, 0.1, 5), 0.11
    save(tmp_path / "lifted.npz", smplh(251, 100.0), poses=np.zeros((251, 156)), trans=trans)
    said = motion_warnings(load_amass_motion(tmp_path / "lifted.npz"))
    assert not [line for line in said if "gravity" in line]
    assert [line for line in said if "faster than anybody can: root at 1.0" in line]


def test_the_given_rate_is_taken_for_the_files_own():
    own = load_amass_motion("sample:walking")
    slow = load_amass_motion("sample:walking", fps=30.0, source_fps=30.0)
    assert (own.source_fps, slow.source_fps) == (60.0, 30.0)
    np.testing.assert_allclose(slow.theta, own.theta)
    assert slow.duration_s == pytest.approx(2 * own.duration_s)


@pytest.mark.parametrize("rate", [0.5, 20_000.0, float("nan")])
def test_what_is_no_rate_is_refused(rate):
    with pytest.raises(DsnetError, match="frames a second; expected 1 to 10000"):
        load_amass_motion("sample:walking", source_fps=rate)


@pytest.mark.licensed
@pytest.mark.skipif(not SAMPLE.exists(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
def test_the_sample_of_amass_says_twice_its_rate():
    assert "falls with 5.5 times gravity at its 120 frames" in warning_of(SAMPLE)
    motion = load_motion(SAMPLE, 60.0)
    assert fall_warning(motion, motion.pieces) == ""
    assert tremor_mm(motion.trans_m, motion.fps) < 0.2
    for rate in (None, 60.0):
        assert pops_of(load_amass_motion(SAMPLE, source_fps=rate)) == {}


FPS = 60.0
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
    return find_pops(motion, motion.pieces)


def test_a_leg_that_flips_and_comes_back_is_one_pop_each_time() -> None:
    pose, trans_m = swaying()
    for frame in (30, 90):
        pose[frame : frame + 3, RIGHT_HIP, 1] = np.radians([60.0, 120.0, 60.0])
    found = motion_of(pose, trans_m)
    assert pops_of(found) == {30: "right_hip", 90: "right_hip"}
    (line,) = motion_warnings(found)
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
