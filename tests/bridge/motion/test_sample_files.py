"""The motions that come with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import load_amass_motion
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.sample_files import SAMPLES, motion_path, sample_path


@pytest.mark.parametrize("name", SAMPLES)
def test_each_is_four_seconds_of_one_movement(name):
    motion = load_amass_motion(f"sample:{name}")
    assert (motion.gender, motion.fps, len(motion.theta)) == ("female", 60.0, 240)
    assert pieces_between_cuts(motion.theta) == [slice(0, 240)]
    assert np.ptp(motion.theta, axis=0).max() > 0.3
    assert sample_path(name).stat().st_size < 50_000


@pytest.mark.parametrize("name", SAMPLES)
def test_each_says_that_it_is_synthetic(name):
    with np.load(sample_path(name)) as arrays:
        assert arrays["source"] == "synthetic"


def test_an_unknown_one_is_refused_with_those_that_there_are():
    with pytest.raises(DsnetError, match=r"sample:flying; expected .*sample:walking"):
        load_amass_motion("sample:flying")


def test_other_paths_stay_what_they_are():
    assert motion_path("a/b.npz") == Path("a/b.npz")
