"""Whatever the vertices and the bound: what is decoded is within it, or it is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bridge import DsnetError
from bridge.exchange.packed.codec import CodedFrames, decode, encode, least_bound, step_for

SHAPES = st.tuples(st.integers(1, 5), st.integers(1, 4), st.just(3))
FRAMES = hnp.arrays(np.float32, SHAPES, elements=st.floats(-(2.0**99), 2.0**99, width=32))


@given(FRAMES, st.floats(1, 1e6))
def test_every_coordinate_is_within_the_bound(frames, times_the_least):
    largest = float(np.abs(frames).max())
    bound = times_the_least * least_bound(largest)
    step = step_for(bound, largest)
    again = decode(encode(frames, step), step, frames.shape)
    assert again.dtype == np.float32
    assert np.abs(again.astype(np.float64) - frames).max() <= bound


@given(hnp.arrays(np.int32, SHAPES, elements=st.integers(-(2**21), 2**21)))
def test_whole_steps_come_back_exactly(steps):
    again = decode(encode(steps * 0.5, 0.5), 0.5, steps.shape)
    np.testing.assert_array_equal(again, steps * 0.5)


def test_what_moves_evenly_takes_one_byte_a_number():
    frames = np.linspace(0, 0.05, 40)[:, None, None] * np.ones((1, 2, 3))
    coded = encode(frames, step_for(1e-5, 0.1))
    assert coded.differences == 2
    assert len(coded.planes) == 1


@pytest.mark.parametrize("bound", [0.0, -1e-3, float("nan"), float("inf"), 1e-9])
def test_a_bound_that_cannot_be_kept_is_refused(bound):
    with pytest.raises(DsnetError, match="bound"):
        step_for(bound, 0.1)


@pytest.mark.parametrize(
    ("planes", "differences"),
    [((0, 6), 1), ((5, 6), 1), ((1, 7), 1), ((1, 6), 3), ((1, 6), -1)],
)
def test_planes_of_another_shape_are_refused(planes, differences):
    with pytest.raises(ValueError, match="planes"):
        decode(CodedFrames(np.zeros(planes, np.uint8), differences), 1.0, (1, 2, 3))


def test_numbers_beyond_float32_are_refused():
    coded = CodedFrames(np.full((4, 6), 255, np.uint8), 1)
    with pytest.raises(ValueError, match="finite"):
        decode(coded, 1e300, (1, 2, 3))
