"""When a body stands still, how damped swings of known decay fall, and what is left at rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.body import load_body_model
from bridge.measure.metrics import Offsets
from bridge.measure.stops import (
    Decays,
    RestSums,
    StillSpan,
    fall_time_s,
    joint_speed_m_s,
    still_spans,
    swing_sums_m,
)

FPS = 60.0


def speeds(*parts: tuple[float, float]) -> np.ndarray:
    """Speed in m/s through stretches of (seconds, speed)."""
    return np.concatenate([np.full(round(s * FPS), speed) for s, speed in parts])


def test_a_translation_has_its_own_speed():
    theta = np.zeros((10, 69))
    theta[:, 66] = 2.0 * np.arange(10) / FPS
    body = load_body_model("embedded:female")
    np.testing.assert_allclose(joint_speed_m_s(body, np.zeros(10), theta, FPS), 2.0)


def test_a_turn_moves_what_is_away_from_its_axis():
    theta = np.zeros((3, 69))
    theta[:, 1] = [0.0, 0.1, 0.2]  # the root about the vertical
    body = load_body_model("embedded:female")
    joints = body.J_regressor @ body.v_template
    radius = np.linalg.norm((joints - joints[0])[:, [0, 2]], axis=1).mean()
    expected = 2 * np.sin(0.05) * FPS * radius
    found = joint_speed_m_s(body, np.zeros(10), theta, FPS)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_stops_are_told_from_standing_and_from_pauses():
    spans = still_spans(speeds((1, 0.0), (1, 1.0), (0.3, 0.0), (0.5, 1.0), (2, 0.05)), FPS)
    assert [(span.frames, span.after_motion) for span in spans] == [
        (slice(0, 60), False),
        (slice(168, 288), True),
    ]
    assert spans[1].settled == slice(276, 288)


def test_sway_is_no_stop():
    assert not still_spans(speeds((1, 0.2), (2, 0.05)), FPS)[0].after_motion
    assert still_spans(speeds((3, 0.2)), FPS) == []


SPAN = StillSpan(slice(30, 150), slice(138, 150), after_motion=True)


def damped(hz: float, rate: float, hanging_m: float = 0.0, size_m: float = 0.01) -> Offsets:
    """A vertex that is held until the stop and then swings freely about where it hangs."""
    times = np.clip(np.arange(150) - SPAN.frames.start, 0, None) / FPS
    curve = hanging_m + size_m * np.exp(-rate * times) * np.cos(2 * np.pi * hz * times)
    offsets = np.zeros((150, 2, 3), np.float32)
    offsets[..., 1] = curve[:, None]
    return Offsets(offsets, FPS)


def swings(offsets: Offsets, span: StillSpan = SPAN) -> np.ndarray:
    return swing_sums_m(offsets, [span]) / offsets.total_m.shape[1]


@given(rate=st.floats(2.5, 12), hz=st.floats(3, 8), hanging=st.floats(-0.02, 0.02))
def test_a_damped_cosine_falls_to_a_fifth_in_its_own_time(rate, hz, hanging):
    curve = swings(damped(hz, rate, hanging))[SPAN.frames]
    # |cos| reaches its envelope twice in a swing: the last time above lies within half of one,
    # and what is not yet settled at the end is mistaken for the level that it swings about.
    late = 0.01 * np.exp(-rate * 1.8)
    early_s, late_s = (np.log(0.01 / (0.002 + sign * late)) / rate for sign in (1, -1))
    found = fall_time_s(curve, FPS)
    assert early_s - 0.5 / hz - 1 / FPS <= found <= late_s + 2 / FPS


def test_an_exponential_falls_exactly():
    curve = np.exp(-3.0 * np.arange(200) / FPS)
    assert fall_time_s(curve, FPS) == pytest.approx(np.log(5) / 3.0, abs=1 / FPS)
    assert fall_time_s(np.zeros(10), FPS) == 0.0
    assert fall_time_s(np.ones(30), FPS) == pytest.approx(0.5)


def test_less_damping_takes_longer_and_the_means_say_so():
    true, predicted = swings(damped(5, 6.0)), swings(damped(5, 3.0, size_m=0.005))
    found = Decays.of(predicted, true, [SPAN], FPS)
    (stop,) = found.stops
    assert stop["true_mm"] == pytest.approx(10.0, rel=0.01)
    assert stop["predicted_mm"] == pytest.approx(5.0, rel=0.02)
    assert stop["predicted_s"] > 1.5 * stop["true_s"]
    found += Decays([{"true_s": 1.0, "predicted_s": 0.5, "true_mm": 1.0, "predicted_mm": 1.0}])
    assert found.summary() == pytest.approx(
        {
            "stops": 2,
            "off_s": (stop["predicted_s"] - stop["true_s"] + 0.5) / 2,
            "true_s": (stop["true_s"] + 1.0) / 2,
            "predicted_s": (stop["predicted_s"] + 0.5) / 2,
            "true_mm": (stop["true_mm"] + 1.0) / 2,
            "predicted_mm": (stop["predicted_mm"] + 1.0) / 2,
        }
    )
    assert Decays().summary() is None


def test_flesh_that_hardly_swings_has_no_decay():
    still = swings(damped(5, 6.0, hanging_m=0.01, size_m=1e-5))
    assert Decays.of(still, still, [SPAN], FPS).stops == []


def test_a_stop_needs_motion_before_it():
    span = StillSpan(slice(0, 60), slice(48, 60), after_motion=False)
    swing_m = swings(damped(5, 3.0), span)
    assert not swing_m.any()
    assert Decays.of(swing_m + 1, swing_m + 1, [span], FPS).stops == []


def test_rest_is_the_mean_of_the_settled_frames():
    true = damped(5, 6.0, hanging_m=0.003, size_m=0.0)
    predicted = damped(5, 6.0, hanging_m=-0.001, size_m=0.0)
    assert RestSums().summary() is None
    rest = RestSums.of(predicted, true, [SPAN])
    assert rest.count == 12 * 2
    assert rest.summary() == pytest.approx({"predicted_mm": 1.0, "true_mm": 3.0, "error_mm": 4.0})
    rest += RestSums.of(true, true, [SPAN])
    assert rest.summary() == pytest.approx({"predicted_mm": 2.0, "true_mm": 3.0, "error_mm": 2.0})
