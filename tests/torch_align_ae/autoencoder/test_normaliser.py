"""Readings of 'normalised to [-1, 1]': ranges, round trips, training frames only."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from bridge.motion.splits import chunks
from torch_align_ae.autoencoder.normaliser import fit_normaliser, offset_statistics

PRESETS = ("global_maximum", "vertex_maximum", "standard")


@pytest.fixture(scope="module")
def offsets_m():
    rng = np.random.default_rng(0)
    scale = np.geomspace(1e-3, 3e-2, 40)[:, None]
    return (rng.standard_normal((300, 40, 3)) * scale + 5e-3).astype(np.float32)


@pytest.mark.parametrize("name", PRESETS)
def test_denormalise_inverts_normalise(offsets_m, name):
    normaliser = fit_normaliser(name, offsets_m, np.arange(200))
    values = torch.from_numpy(offsets_m)
    np.testing.assert_allclose(
        normaliser.denormalise(normaliser.normalise(values)), values, atol=1e-8
    )


@pytest.mark.parametrize("name", ["global_maximum", "vertex_maximum"])
def test_training_frames_fill_minus_one_to_one(offsets_m, name):
    frames = np.arange(0, 300, 2)
    values = fit_normaliser(name, offsets_m, frames).normalise(torch.from_numpy(offsets_m[frames]))
    largest = values.abs().amax(dim=0) if name == "vertex_maximum" else values.abs().max()
    np.testing.assert_allclose(largest, 1, rtol=1e-6)


def test_standard_values_have_mean_zero_and_deviation_one(offsets_m):
    values = fit_normaliser("standard", offsets_m, np.arange(300)).normalise(
        torch.from_numpy(offsets_m)
    )
    np.testing.assert_allclose(values.mean(dim=0), 0, atol=1e-5)
    np.testing.assert_allclose(values.square().mean().sqrt(), 1, rtol=1e-5)


@pytest.mark.parametrize("name", PRESETS)
def test_other_frames_do_not_enter(offsets_m, name):
    changed = offsets_m.copy()
    changed[200:] = 9.0
    first, second = (fit_normaliser(name, x, np.arange(200)) for x in (offsets_m, changed))
    np.testing.assert_array_equal(first.mean_m, second.mean_m)
    np.testing.assert_array_equal(first.scale_m, second.scale_m)


def test_streamed_statistics_are_numpys(offsets_m):
    frames = np.random.default_rng(1).permutation(300)[:257]
    found, part = offset_statistics(offsets_m, frames), offsets_m[frames].astype(np.float64)
    np.testing.assert_allclose(found.mean_m, part.mean(axis=0), rtol=1e-12)
    np.testing.assert_array_equal(found.smallest_m, part.min(axis=0))
    np.testing.assert_array_equal(found.largest_m, part.max(axis=0))
    np.testing.assert_allclose(found.deviation_m, (part - part.mean(axis=0)).std(), rtol=1e-9)


@pytest.mark.parametrize("name", PRESETS)
def test_still_vertices_stay_finite(name):
    normaliser = fit_normaliser(name, np.zeros((4, 5, 3), np.float32), np.arange(4))
    assert torch.isfinite(normaliser.normalise(torch.zeros(1, 5, 3))).all()


def test_chunks_keep_the_asked_order(offsets_m):
    frames = np.array([7, 3, 11, 0, 299])
    np.testing.assert_array_equal(
        np.concatenate(list(chunks(offsets_m, frames, 2))), offsets_m[frames]
    )
