"""Velocity errors against the plain formula, and the summary of cases whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.measure.trajectories import Trajectories, vertex_pieces
from bridge.measure.velocity import VelocityErrors


def measured(predicted_m, true_m, fps=60.0, cut=None):
    errors = VelocityErrors()
    for piece in (slice(None, cut), slice(cut, None)) if cut else (slice(None),):
        errors.add(Trajectories(predicted_m[:, piece], fps), Trajectories(true_m[:, piece], fps))
    return errors


def test_pieces_of_the_mesh_sum_to_the_plain_formula():
    predicted, true = 0.01 * np.random.default_rng(0).normal(size=(2, 9, 7, 3))
    found = measured(predicted, true, cut=3).summary()
    moved, real = 60 * np.diff(predicted, axis=0), 60 * np.diff(true, axis=0)
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
    assert measured(true + 0.5, true).summary()["r2"] == pytest.approx(1.0)
    assert measured(np.zeros_like(true), true).summary()["r2"] == pytest.approx(0.0)


def test_what_never_moves_has_no_r2():
    still = np.ones((4, 5, 3))
    assert np.isnan(measured(still, still).summary()["r2"])


def test_merging_is_adding():
    predicted, true = 0.01 * np.random.default_rng(1).normal(size=(2, 9, 7, 3))
    first, second = measured(predicted[:, :2], true[:, :2]), measured(predicted[:, 2:], true[:, 2:])
    first.merge(second)
    assert first.summary() == pytest.approx(measured(predicted, true).summary())


def test_pieces_cover_every_vertex_once():
    pieces = list(vertex_pieces(17, 5))
    assert [v for piece in pieces for v in range(piece.start, piece.stop)] == [*range(17)]
