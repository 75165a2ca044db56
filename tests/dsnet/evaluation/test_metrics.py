"""Metrics against the plain formulas; the spectrum of cosines and of a damped swing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsnet.evaluation.metrics import (
    BANDS_HZ,
    BIN_HZ,
    ErrorSums,
    GroupErrors,
    Offsets,
    SpectrumSums,
    VelocitySums,
    frame_blocks,
)

FPS, FRAMES = 60.0, 240
SECONDS = np.arange(FRAMES) / FPS
_EVERYWHERE = np.ones((1, 4, 3))


@given(seed=st.integers(0, 10**6), cut=st.integers(1, 6))
def test_streamed_sums_are_the_plain_formulas(seed, cut):
    rng = np.random.default_rng(seed)
    predicted, reference = rng.normal(scale=0.01, size=(2, 7, 50, 3))
    sums = ErrorSums()
    sums.add(predicted[:cut], reference[:cut])
    other = ErrorSums()
    other.add(predicted[cut:], reference[cut:])
    sums += other
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


def velocities(predicted_m, true_m, cut=None):
    errors = VelocitySums()
    for piece in (slice(None, cut), slice(cut, None)) if cut else (slice(None),):
        errors += VelocitySums.of(*(Offsets(one[:, piece], FPS) for one in (predicted_m, true_m)))
    return errors


def test_pieces_of_the_mesh_sum_to_the_plain_formula():
    predicted, true = 0.01 * np.random.default_rng(0).normal(size=(2, 9, 7, 3))
    found = velocities(predicted, true, cut=3).summary()
    moved, real = FPS * np.diff(predicted, axis=0), FPS * np.diff(true, axis=0)
    distance = np.linalg.norm(moved - real, axis=-1)
    expected = {
        "r2": 1 - np.square(moved - real).sum() / np.square(real).sum(),
        "mean_mm_s": 1e3 * distance.mean(),
        "rms_mm_s": 1e3 * np.sqrt(np.square(distance).mean()),
        "true_rms_mm_s": 1e3 * np.sqrt(np.square(real).sum(-1).mean()),
    }
    assert found == pytest.approx(expected)


def test_a_constant_error_is_no_error_of_velocity():
    true = 0.01 * np.random.default_rng(0).normal(size=(9, 7, 3))
    assert velocities(true + 0.5, true).summary()["r2"] == pytest.approx(1.0)
    assert velocities(np.zeros_like(true), true).summary()["r2"] == pytest.approx(0.0)


def test_what_never_moves_has_no_r2():
    still = np.ones((4, 5, 3))
    assert np.isnan(velocities(still, still).summary()["r2"])


def swing(hz: float, damping: float = 0.0, size_m: float = 1e-3) -> np.ndarray:
    """(T, 4, 3) a damped cosine of amplitude `size_m` in each coordinate."""
    # Half a frame on: this is then a vector of the cosine transform's own basis.
    times = SECONDS + 0.5 / FPS
    curve = size_m * np.exp(-damping * times) * np.cos(2 * np.pi * hz * times)
    return curve[:, None, None] * _EVERYWHERE


def spectrum(predicted_m, true_m):
    return SpectrumSums.of(Offsets(predicted_m, FPS), Offsets(true_m, FPS))


@given(hz=st.integers(1, 118).map(lambda k: 0.25 * k))
def test_a_cosine_lies_in_its_own_step(hz):
    sums = spectrum(swing(hz), swing(hz))
    expected = np.zeros(60)
    # Of a cosine of amplitude a in three coordinates: 3 a^2 / 2, over vertices and frames.
    expected[int(hz / BIN_HZ)] = 1.5e-6 * FRAMES * 4
    np.testing.assert_allclose(sums.energy[0], expected, atol=1e-12)
    np.testing.assert_allclose(sums.energy[2], 0.0, atol=1e-12)


def test_bands_hold_all_the_energy():
    rng = np.random.default_rng(0)
    predicted, true = 1e-3 * rng.normal(size=(2, FRAMES, 4, 3))
    bands = spectrum(predicted, true).summary()["bands"]
    assert [(band["from_hz"], band["to_hz"]) for band in bands] == list(BANDS_HZ)
    for name, values in (("true_mm", true), ("predicted_mm", predicted)):
        total = sum(band[name] ** 2 for band in bands)
        assert total == pytest.approx(1e6 * np.square(values).sum(-1).mean())
    error = sum((1 - band["r2"]) * band["true_mm"] ** 2 for band in bands)
    assert error == pytest.approx(1e6 * np.square(predicted - true).sum(-1).mean())


def test_half_a_swing_has_half_its_size_and_three_quarters_r2():
    band = spectrum(swing(5) / 2, swing(5)).summary()["bands"][2]
    assert (band["ratio"], band["r2"]) == pytest.approx((0.5, 0.75))


def test_a_damped_swing_is_found_at_its_frequency_beside_a_larger_slow_drift():
    true = swing(5.25, damping=3.0) + swing(0.5, size_m=5e-3)
    sums = spectrum(0.5 * true, true)
    assert sums.peak_hz() == pytest.approx(5.25, abs=0.51)
    assert sums.summary()["own"]["ratio"] == pytest.approx(0.5)
    # Continued evenly into the past, the amplitude at f is that of 1 / (1 + u^2), u = 2 pi (f - f0)
    # / damping; its square's integral is half of atan u + u / (1 + u^2).
    low, high = (2 * np.pi * (edge - 5.25) / 3.0 for edge in (3.5, 7.5))
    low, high = (np.arctan(u) + u / (1 + u**2) for u in (low, high))
    alone = spectrum(0 * true, swing(5.25, damping=3.0))
    share = alone.summary()["own"]["true_mm"] ** 2 / (1e6 * alone.energy[0].sum() / alone.count)
    assert share == pytest.approx((high - low) / np.pi, abs=0.005)


def test_the_step_from_the_end_to_the_start_is_no_movement():
    ramp = np.linspace(0, 1e-2, FRAMES)[:, None, None] * _EVERYWHERE
    sums = spectrum(ramp, ramp)
    assert sums.energy[0, 4:].sum() < 1e-4 * sums.energy[0].sum()


def test_a_band_without_energy_has_no_ratio():
    band = spectrum(swing(5), swing(5) * 0).summary()["bands"][2]
    assert np.isnan(band["ratio"])
    assert np.isnan(band["r2"])
    assert band["predicted_mm"] > 1


def test_errors_of_a_group_are_those_of_all_frames_at_once():
    rng = np.random.default_rng(0)
    predicted, reference = rng.normal(0, 1e-2, (2, 6, 2, 5, 3))
    group, whole = GroupErrors(), ErrorSums()
    for found_m, true_m in zip(predicted, reference, strict=True):
        mesh = ErrorSums()
        mesh.add(found_m, true_m)
        group.add({"mesh": mesh})
    whole.add(predicted.reshape(12, 5, 3), reference.reshape(12, 5, 3))
    found = group.summary()["mesh"]
    spread = found.pop("r2_se")
    assert found == pytest.approx(whole.summary())
    assert 0 < spread < 1


def test_a_groups_sums_are_none_of_its_sequences():
    mesh, group = ErrorSums(count=1), GroupErrors()
    for _ in range(3):
        group.add({"mesh": mesh})
    (total,) = group.sums.values()
    assert isinstance(total, ErrorSums)
    assert (mesh.count, total.count) == (1, 3)
