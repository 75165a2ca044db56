"""What leaves and comes back within some frames is interpolated and told; motion stays as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.motion import Motion, load_motion, pack_theta, unpack_theta
from bridge.motion.readers.amass import SAMPLES, sample_path
from bridge.motion.repairs import find_spikes, without_spikes
from bridge.motion.speeds import WHAT_MOVES

FPS = 60.0
FIRST = 40
PELVIS, SPINE, KNEE, HEAD, ROOT = 0, 3, 4, 15, 22


def swaying() -> tuple[np.ndarray, np.ndarray]:
    """Joint rotations (T, 22, 3) and translations (T, 3) of somebody who sways for two seconds."""
    time_s = np.arange(120) / FPS
    pose, trans_m = np.zeros((120, 22, 3)), np.zeros((120, 3))
    pose[:] = 0.3 * np.sin(6 * time_s)[:, None, None] * [0.5, 0.2, 1.0]
    trans_m[:] = 0.1 * np.sin(6 * time_s)[:, None]
    return pose, trans_m


def motion_of(pose: np.ndarray, trans_m: np.ndarray) -> Motion:
    theta = pack_theta(pose, trans_m)
    return Motion(theta, np.zeros(10), "unknown", FPS, FPS, Path("walk.bvh"))


@pytest.mark.parametrize("frames", [1, 2, 4, 6])
@pytest.mark.parametrize("what", [PELVIS, SPINE, KNEE, HEAD, ROOT])
def test_a_spike_is_interpolated_and_told(what: int, frames: int) -> None:
    pose, trans_m = swaying()
    true = motion_of(pose, trans_m)
    spiked, place_m = pose.copy(), trans_m.copy()
    if what == ROOT:
        place_m[FIRST : FIRST + frames] += [0.3, 0.0, 0.0]
    else:
        turned = Rotation.from_rotvec(pose[FIRST : FIRST + frames, what])
        spiked[FIRST : FIRST + frames, what] = (
            turned * Rotation.from_euler("x", 170, degrees=True)
        ).as_rotvec()
    mended = without_spikes(motion_of(spiked, place_m))
    assert mended.cuts == ()
    np.testing.assert_allclose(mended.theta, true.theta, atol=0.05)
    outside = np.delete(np.arange(120), np.arange(FIRST - 1, FIRST + frames))
    np.testing.assert_array_equal(mended.theta[outside], true.theta[outside])
    (note,) = mended.notes
    assert f"{WHAT_MOVES[what]} at 0.6" in note


def test_what_leaves_bit_by_bit_is_a_spike_too() -> None:
    pose, trans_m = swaying()
    pose[:] = 0
    pose[FIRST : FIRST + 3, KNEE, 0] = np.radians([70.0, 140.0, 70.0])
    assert find_spikes(pose, trans_m, FPS) == [(FIRST, FIRST + 3, KNEE)]


def test_what_stays_or_comes_back_late_is_none() -> None:
    pose, trans_m = swaying()
    pose[FIRST:, SPINE] += [np.pi, 0, 0]
    pose[80 : 80 + 20, HEAD] += [np.pi, 0, 0]
    trans_m[60:, 0] += 2.0
    trans_m[20:26, 1] += np.linspace(0.03, 0.15, 6)  # lifted within a tenth of a second
    trans_m[26:, 1] += 0.15
    assert find_spikes(pose, trans_m, FPS) == []
    motion = motion_of(pose, trans_m)
    assert without_spikes(motion) is motion


def test_at_a_wrong_rate_nothing_is_mended() -> None:
    assert find_spikes(*unpack_theta(motion_of(*swaying()).theta), 40 * FPS) == []


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_have_none(name: str) -> None:
    motion = load_motion(sample_path(name))
    assert find_spikes(motion.pose, motion.trans_m, motion.fps) == []
