"""The motions that come with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import load_amass_motion
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.loops import close_lap
from bridge.motion.sample_files import CYCLE, SAMPLES, motion_path, sample_path


@pytest.mark.parametrize("name", SAMPLES)
def test_each_is_one_movement_of_four_seconds_or_one_lap(name):
    motion, frames = load_amass_motion(f"sample:{name}"), 61 if name == CYCLE else 240
    assert (motion.gender, motion.fps, len(motion.theta)) == ("female", 60.0, frames)
    assert pieces_between_cuts(motion.theta) == [slice(0, frames)]
    assert np.ptp(motion.theta, axis=0).max() > 0.3
    assert sample_path(name).stat().st_size < 50_000


def test_one_repeats_in_place():
    lap = close_lap(load_amass_motion(f"sample:{CYCLE}").theta, np.zeros(3))
    assert lap.dropped
    np.testing.assert_allclose(lap.repeated(3), np.tile(lap.theta, (3, 1)), atol=1e-6)


@pytest.mark.parametrize("name", sorted({*SAMPLES} - {CYCLE}))
def test_the_others_do_not_and_say_which_does(name):
    with pytest.raises(DsnetError, match=r"--loop with a motion.* as sample:walk_cycle is"):
        close_lap(load_amass_motion(f"sample:{name}").theta, np.zeros(3))


@pytest.mark.parametrize("name", SAMPLES)
def test_each_says_that_it_is_synthetic(name):
    with np.load(sample_path(name)) as arrays:
        assert arrays["source"] == "synthetic"


def test_an_unknown_one_is_refused_with_those_that_there_are():
    with pytest.raises(DsnetError, match=r"sample:flying; expected .*sample:walking"):
        load_amass_motion("sample:flying")


def test_other_paths_stay_what_they_are():
    assert motion_path("a/b.npz") == Path("a/b.npz")
