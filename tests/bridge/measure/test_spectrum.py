"""The spectrum of cosines and of a damped swing, whose frequencies are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.measure.spectrum import BANDS_HZ, STEP_HZ, SpectrumSums, bins_of
from bridge.measure.trajectories import Trajectories

FPS, FRAMES = 60.0, 240
SECONDS = np.arange(FRAMES) / FPS
_EVERYWHERE = np.ones((1, 4, 3))


def swing(hz: float, damping: float = 0.0, size_m: float = 1e-3) -> np.ndarray:
    """(T, 4, 3) a damped cosine of amplitude `size_m` in each coordinate."""
    # Half a frame on: this is then a vector of the cosine transform's own basis.
    times = SECONDS + 0.5 / FPS
    curve = size_m * np.exp(-damping * times) * np.cos(2 * np.pi * hz * times)
    return curve[:, None, None] * _EVERYWHERE


def measured(predicted_m, true_m):
    sums = SpectrumSums()
    sums.add(Trajectories(predicted_m, FPS), Trajectories(true_m, FPS))
    return sums


@given(hz=st.integers(1, 118).map(lambda k: 0.25 * k))
def test_a_cosine_lies_in_its_own_step(hz):
    sums = measured(swing(hz), swing(hz))
    expected = np.zeros(60)
    # Of a cosine of amplitude a in three coordinates: 3 a^2 / 2, over vertices and frames.
    expected[int(hz / STEP_HZ)] = 1.5e-6 * FRAMES * 4
    np.testing.assert_allclose(sums.true, expected, atol=1e-12)
    np.testing.assert_allclose(sums.error, 0.0, atol=1e-12)


def test_bands_hold_all_the_energy():
    rng = np.random.default_rng(0)
    predicted, true = 1e-3 * rng.normal(size=(2, FRAMES, 4, 3))
    bands = measured(predicted, true).summary()["bands"]
    assert [(band["from_hz"], band["to_hz"]) for band in bands] == list(BANDS_HZ)
    for name, values in (("true_mm", true), ("predicted_mm", predicted)):
        total = sum(band[name] ** 2 for band in bands)
        assert total == pytest.approx(1e6 * np.square(values).sum(-1).mean())
    error = sum((1 - band["r2"]) * band["true_mm"] ** 2 for band in bands)
    assert error == pytest.approx(1e6 * np.square(predicted - true).sum(-1).mean())


def test_half_a_swing_has_half_its_size_and_three_quarters_r2():
    band = measured(swing(5) / 2, swing(5)).summary()["bands"][2]
    assert (band["ratio"], band["r2"]) == pytest.approx((0.5, 0.75))


def test_a_damped_swing_is_found_at_its_frequency_beside_a_larger_slow_drift():
    true = swing(5.25, damping=3.0) + swing(0.5, size_m=5e-3)
    sums = measured(0.5 * true, true)
    assert sums.own_hz() == pytest.approx(5.25, abs=0.51)
    assert sums.summary()["own"]["ratio"] == pytest.approx(0.5)
    # Continued evenly into the past, the amplitude at f is that of 1 / (1 + u^2), u = 2 pi (f - f0)
    # / damping; its square's integral is half of atan u + u / (1 + u^2).
    low, high = (2 * np.pi * (edge - 5.25) / 3.0 for edge in (3.5, 7.5))
    low, high = (np.arctan(u) + u / (1 + u**2) for u in (low, high))
    alone = measured(0 * true, swing(5.25, damping=3.0))
    share = alone.summary()["own"]["true_mm"] ** 2 / (1e6 * alone.true.sum() / alone.count)
    assert share == pytest.approx((high - low) / np.pi, abs=0.005)


def test_the_step_from_the_end_to_the_start_is_no_movement():
    ramp = np.linspace(0, 1e-2, FRAMES)[:, None, None] * _EVERYWHERE
    sums = measured(ramp, ramp)
    assert sums.true[4:].sum() < 1e-4 * sums.true.sum()


def test_a_band_without_energy_has_no_ratio():
    band = measured(swing(5), swing(5) * 0).summary()["bands"][2]
    assert np.isnan(band["ratio"])
    assert np.isnan(band["r2"])
    assert band["predicted_mm"] > 1


def test_other_lengths_have_the_same_steps():
    assert bins_of(240, 60.0)[20] == bins_of(480, 60.0)[40] == 5
    assert bins_of(90, 60.0).max() == 59
