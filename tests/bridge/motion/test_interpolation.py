"""Poses between two poses, and after them."""

from __future__ import annotations

import numpy as np

from bridge.motion.interpolation import between, going_on
from tests.forged.swaying import swaying


def test_between_ends_where_it_should_and_goes_the_short_way():
    before, after = swaying(np.array([0.0, 0.1, 0.2])), swaying(np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(between(before, after, np.zeros(3)), before, atol=1e-12)
    np.testing.assert_array_equal(between(before, after, np.ones(3)), after)
    mixed = between(before, after, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_array_equal(mixed[2], after[2])
    np.testing.assert_allclose(mixed[1], (before[1] + after[1]) / 2, atol=2e-3)
    np.testing.assert_allclose(mixed[1, 66:], (before[1] + after[1])[66:] / 2, atol=1e-12)


def test_between_keeps_the_turns_of_a_spin():
    before = np.zeros((1, 69))
    before[0, 1] = 3 * 2 * np.pi + 0.2
    after = before + 0.1 * np.eye(69)[1]
    np.testing.assert_allclose(
        between(before, after, np.array([0.5])), before + (after - before) / 2
    )


def test_going_on_repeats_the_last_change():
    before, last = swaying(np.array([0.0, 1 / 60]))
    following = going_on(before, last)
    np.testing.assert_allclose(between(before[None], following[None], np.array([0.5]))[0], last)
    np.testing.assert_allclose(going_on(last, last), last, atol=1e-12)
