"""What a DSNet is told of a motion."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange.clips import join_inputs
from bridge.exchange.input_kinds import DIFFERENCES, POSES, input_kind_of
from bridge.exchange.trained_dsnet import TrainedDsnet

RNG = np.random.default_rng(3)


def test_poses_are_the_papers_inputs():
    joined = join_inputs(RNG.normal(size=(7, 69)), RNG.normal(size=10))
    np.testing.assert_array_equal(POSES.of(joined), joined)
    assert POSES.size == 79


def test_differences_are_those_of_a_parabola():
    """theta = p + v t + a t^2 / 2 changes by v - a / 2 + a t a frame, and that by a."""
    start, speed, acceleration = RNG.normal(size=(3, 69))
    frames = np.arange(20.0)[:, None]
    theta = start + speed * frames + acceleration * frames**2 / 2
    betas = RNG.normal(size=10)
    found = DIFFERENCES.of(join_inputs(theta, betas))
    assert found.shape == (20, DIFFERENCES.size) == (20, 148)
    np.testing.assert_array_equal(found[:, :10], np.tile(betas, (20, 1)))
    first, second = found[:, 10:79] / 6, found[:, 79:] / 36
    expected = speed + acceleration * (frames[1:] - 0.5)
    np.testing.assert_allclose(first[1:], expected, atol=1e-12)
    np.testing.assert_allclose(second[2:], np.tile(acceleration, (18, 1)), atol=1e-12)
    assert not first[0].any()
    assert not second[:2].any()


def test_where_a_motion_happens_is_not_told():
    theta, betas = RNG.normal(size=(9, 69)), RNG.normal(size=10)
    here, there = (DIFFERENCES.of(join_inputs(theta + by, betas)) for by in (0.0, 3.0))
    np.testing.assert_allclose(here, there, atol=1e-12)


@pytest.mark.parametrize("frames", [1, 2])
def test_the_shortest_motions_have_no_differences_to_tell(frames):
    found = DIFFERENCES.of(np.zeros((frames, 79)))
    np.testing.assert_array_equal(found, np.zeros((frames, 148)))


@pytest.mark.parametrize("kind", [POSES, DIFFERENCES])
def test_a_network_says_what_it_is_told(kind):
    weights = {"fc_enc_1/kernel": np.zeros((kind.size, 64), np.float32)}
    assert input_kind_of(weights) is kind
    unscaled = TrainedDsnet.from_arrays("n", weights)
    joined = join_inputs(RNG.normal(size=(5, 69)), RNG.normal(size=10))
    np.testing.assert_allclose(unscaled.inputs(joined), kind.of(joined), atol=1e-5)


@pytest.mark.parametrize("weights", [{}, {"fc_enc_1/kernel": np.zeros((80, 64))}])
def test_other_networks_are_refused(weights):
    with pytest.raises(DsnetError, match=r"79 \(poses\) or 148 \(pose differences\)"):
        input_kind_of(weights)
