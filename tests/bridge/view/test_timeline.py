"""Play, pause, scrub and speed."""

from __future__ import annotations

import pytest

pytest.importorskip("viser", reason="viser is not installed")
from bridge.view.panel import Timeline


def test_it_is_as_fast_as_the_motion_and_begins_again():
    timeline = Timeline(frames=90, fps=60.0)
    assert timeline.pass_time(0.5) == 30
    assert timeline.time_s == 0.5
    assert timeline.pass_time(1.25) == 15


def test_speed_and_pause():
    timeline = Timeline(frames=90, fps=60.0, speed=0.25)
    assert timeline.pass_time(1.0) == 15
    timeline.playing = False
    assert timeline.pass_time(10.0) == 15


def test_steps_shorter_than_a_frame_add_up():
    timeline = Timeline(frames=1000, fps=60.0, speed=0.1)
    for _ in range(100):
        timeline.pass_time(0.01)
    assert timeline.frame in (5, 6)


def test_one_goes_to_a_frame_that_there_is():
    timeline = Timeline(frames=90)
    seen = []
    for frame in (40, -3, 200):
        timeline.go_to(frame)
        seen.append(timeline.frame)
    assert seen == [40, 0, 89]
    timeline.begin(10, 30.0)
    assert (timeline.frame, timeline.pass_time(0.1)) == (0, 3)
