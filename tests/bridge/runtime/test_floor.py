"""Another body's feet stand on the floor, jumps last as long, strides fit the legs."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.posing import Smpl
from bridge.motion import Motion, load_amass_motion, pack_theta, unpack_theta
from bridge.runtime.controls import leg_length_m, lowest_points_m, put_on_floor
from bridge.runtime.moving_body import place_motion
from tests.forged.cyclic import circling

BODY = load_body_model("embedded:female")
OWN, TALL = np.zeros(10), np.r_[2.5, np.zeros(9)]
SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"


def posed_lowest_m(motion: Motion) -> np.ndarray:
    """(T,) over all vertices."""
    pose, trans = unpack_theta(motion.theta)
    return Smpl(BODY).person(motion.betas).pose(pose, trans)[..., 1].min(axis=1)


@pytest.fixture(scope="module")
def recorded() -> Motion:
    """As a file has it, of a person of mean shape: she walks a circle, then jumps."""
    theta = circling(60)
    times_s = np.arange(20) / 60
    air = np.repeat(theta[-1:], 20, axis=0)
    air[:, -2] += 1.6 * times_s - 4.905 * times_s**2 + 0.01
    walked = np.concatenate([theta, air])
    motion = Motion(walked, OWN, "female", 60.0, 60.0, Path("forged"))
    # Her own soles touch the floor at 0.
    placed = place_motion(motion, BODY)
    pose, trans = unpack_theta(walked)
    low = posed_lowest_m(placed).min()
    return replace(motion, theta=pack_theta(pose, trans - [0.0, low, 0.0]))


def test_few_vertices_find_the_lowest_point(recorded):
    placed = place_motion(recorded, BODY, TALL)
    np.testing.assert_allclose(lowest_points_m(placed, BODY), posed_lowest_m(placed), atol=2e-3)


@pytest.mark.parametrize("floor", ["shift", "scale"])
@pytest.mark.parametrize("betas", [TALL, -TALL], ids=["tall", "short"])
def test_another_body_stands_on_the_floor(recorded, floor, betas):
    placed = place_motion(recorded, BODY, betas)
    assert abs(posed_lowest_m(placed).min()) > 0.05
    stood = put_on_floor(placed, BODY, floor, place_motion(recorded, BODY))
    assert abs(posed_lowest_m(stood).min()) < 0.005


def test_kept_is_untouched(recorded):
    placed = place_motion(recorded, BODY, TALL)
    assert put_on_floor(placed, BODY, "keep", placed) is placed


def test_a_shift_is_one_number(recorded):
    """So who jumps is in the air as long as before."""
    placed = place_motion(recorded, BODY, TALL)
    moved = put_on_floor(placed, BODY, "shift", placed).theta - placed.theta
    np.testing.assert_allclose(moved[:, -2], moved[0, -2], atol=1e-12)
    assert not moved[:, :-2].any()
    assert not moved[:, -1].any()


def test_one_bad_frame_does_not_lift_the_motion(recorded):
    theta = np.tile(recorded.theta, (3, 1))
    theta[100, -2] -= 0.4
    motion = replace(recorded, theta=theta)
    stood = put_on_floor(place_motion(motion, BODY, TALL), BODY, "shift", motion)
    assert abs(np.delete(posed_lowest_m(stood), 100).min()) < 0.01


def test_strides_grow_with_the_legs(recorded):
    ratio = leg_length_m(BODY, TALL) / leg_length_m(BODY, OWN)
    assert ratio > 1.1
    before = place_motion(recorded, BODY)
    after = put_on_floor(place_motion(recorded, BODY, TALL), BODY, "scale", before)
    (_, own), (_, trans) = unpack_theta(before.theta), unpack_theta(after.theta)
    np.testing.assert_allclose(np.diff(trans, axis=0), ratio * np.diff(own, axis=0), atol=1e-12)


def test_her_own_body_keeps_her_strides(recorded):
    own = place_motion(recorded, BODY)
    scaled = put_on_floor(own, BODY, "scale", own)
    np.testing.assert_allclose(scaled.theta, own.theta, atol=3e-3)


def test_legs_that_are_none_are_refused(recorded):
    strange = replace(recorded, betas=np.r_[1e3, np.zeros(9)])
    with pytest.raises(DsnetError, match=r"--floor scale .*Pass --floor shift"):
        put_on_floor(place_motion(strange, BODY, TALL), BODY, "scale", strange)


@pytest.mark.licensed
@pytest.mark.skipif(not SAMPLE.exists(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
@pytest.mark.parametrize("floor", ["shift", "scale"])
def test_a_recorded_motion_of_another_body_stands(floor):
    """She jumps: lowest where she lands, on her toes."""
    motion = load_amass_motion(SAMPLE)
    for betas in (None, TALL, -TALL):
        placed = place_motion(motion, BODY, betas)
        assert abs(posed_lowest_m(placed).min()) > 0.02
        low_m = posed_lowest_m(put_on_floor(placed, BODY, floor, place_motion(motion, BODY)))
        assert -0.006 < low_m.min() < 0.001
        assert 0.0 < np.median(low_m[-18:]) < 0.04
        assert low_m.max() > 0.1
