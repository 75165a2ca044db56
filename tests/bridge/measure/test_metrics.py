"""Metrics against the plain formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bridge.measure.metrics import ErrorSums, frame_blocks, mean_offset_m, rotation_error_deg


@given(seed=st.integers(0, 10**6), cut=st.integers(1, 6))
def test_streamed_sums_are_the_plain_formulas(seed, cut):
    rng = np.random.default_rng(seed)
    predicted, reference = rng.normal(scale=0.01, size=(2, 7, 50, 3))
    sums = ErrorSums()
    sums.add(predicted[:cut], reference[:cut])
    other = ErrorSums()
    other.add(predicted[cut:], reference[cut:])
    sums.merge(other)
    distance = np.linalg.norm(predicted - reference, axis=-1)
    expected = {
        "r2": 1 - ((predicted - reference) ** 2).sum() / (reference**2).sum(),
        "mean_mm": 1e3 * distance.mean(),
        "rms_mm": 1e3 * np.sqrt((distance**2).mean()),
        "max_mm": 1e3 * distance.max(),
    }
    found = sums.summary()
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-12)
    ordered = np.sort(distance, axis=None)
    rank = int(np.ceil(0.95 * ordered.size)) - 1
    np.testing.assert_allclose(found["p95_mm"], 1e3 * ordered[rank], atol=0.0101)


def test_r2_of_nothing_is_zero_and_of_the_truth_one():
    reference = np.random.default_rng(0).normal(size=(3, 5, 3))
    alone, perfect = ErrorSums(), ErrorSums()
    alone.add(np.zeros_like(reference), reference)
    perfect.add(reference, reference)
    assert (alone.r2, perfect.r2) == (0.0, 1.0)


def test_r2_without_reference_is_not_a_number():
    sums = ErrorSums()
    sums.add(np.ones((1, 2, 3)), np.zeros((1, 2, 3)))
    assert np.isnan(sums.r2)


def test_errors_beyond_the_histogram_keep_their_size():
    sums = ErrorSums()
    sums.add(np.full((1, 4, 3), 2.0), np.zeros((1, 4, 3)))
    assert sums.summary()["p95_mm"] == pytest.approx(500.0)
    assert sums.summary()["max_mm"] == pytest.approx(2e3 * np.sqrt(3))


def test_blocks_cover_the_range_once():
    blocks = list(frame_blocks(slice(5, 17), 5))
    assert [frame for block in blocks for frame in range(block.start, block.stop)] == [
        *range(5, 17)
    ]


def test_mean_offset_is_the_ranges_own():
    offsets = np.random.default_rng(0).normal(size=(90, 4, 3)).astype(np.float32)
    expected = offsets[3:80].astype(np.float64).mean(axis=0)
    np.testing.assert_allclose(mean_offset_m(offsets, slice(3, 80)), expected, atol=1e-12)


@given(seed=st.integers(0, 10**6), angle_deg=st.floats(0, 180))
def test_rotation_error_is_the_angle_between(seed, angle_deg):
    rng = np.random.default_rng(seed)
    reference = Rotation.random(2, rng)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(angle_deg) * axis / np.linalg.norm(axis))
    found = rotation_error_deg((reference * turn).as_rotvec(), reference.as_rotvec())
    np.testing.assert_allclose(found, angle_deg, atol=1e-5)
