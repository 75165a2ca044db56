"""Ticks among frames: none is lost or comes twice, and none lies elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge import DsnetError
from dsnet.stream.frame_clock import FrameClock

RATES = (23.976, 24, 30, 50, 59.94, 60, 72, 90, 120, 144, 240)


@pytest.mark.parametrize("fps", RATES)
def test_every_tick_comes_once_between_its_frames(fps):
    clock, ticks = FrameClock(fps), []
    for frame in range(1000):
        for tick in clock.ticks(frame):
            time_s = (frame - 1 + clock.fraction(tick, frame)) / fps
            assert time_s == pytest.approx(tick / 60, abs=1e-5)
            assert 0 < clock.fraction(tick, frame) <= 1
            ticks.append(tick)
    assert ticks == list(range(len(ticks)))
    assert len(ticks) == pytest.approx(999 * 60 / fps + 1, abs=1)


def test_television_is_not_off_after_a_day():
    clock = FrameClock(30_000 / 1001)
    frame = 24 * 3600 * 30
    tick, share = clock.place(frame)
    assert tick + share == pytest.approx(frame * 1001 / 500, abs=1e-6)


@given(st.sampled_from(RATES), st.integers(0, 3), st.integers(0, 2000))
def test_what_a_frame_needs_is_known_when_it_is_answered_and_not_a_frame_before(fps, ahead, frame):
    clock = FrameClock(fps)
    latency = clock.latency_frames(ahead)

    def known(frame: int, late: int) -> bool:
        tick, share = clock.place(frame)
        newest, _ = clock.place(frame + late)
        return newest - ahead >= tick + (share > 0)

    assert known(frame, latency)
    if latency:
        assert not all(known(other, latency - 1) for other in range(1001))


@pytest.mark.parametrize(
    ("fps", "ahead", "expected"),
    [(60, 0, 0), (60, 1, 1), (30, 0, 0), (30, 1, 1), (120, 0, 1), (120, 1, 3), (90, 1, 3)],
)
def test_latencies(fps, ahead, expected):
    assert FrameClock(fps).latency_frames(ahead) == expected


@pytest.mark.parametrize("fps", [0, -60, 9, 1001, np.nan, np.inf, None, "fast", [60, 60]])
def test_rates_of_nothing_are_refused(fps):
    with pytest.raises(DsnetError, match="fps="):
        FrameClock(fps)


def test_a_rate_as_a_file_stores_it_is_one():
    stored: Any = np.array(120.0)
    assert FrameClock(stored).fps == 120
