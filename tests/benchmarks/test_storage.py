"""Every way to store vertices gives them back within what it promises."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.storage.__main__ import Source, measure
from benchmarks.storage.candidates import candidates
from benchmarks.storage.page import page
from benchmarks.storage.subspace import Subspace


@pytest.fixture(scope="module")
def frames():
    """(40, 50, 3) metres."""
    rng = np.random.default_rng(0)
    swinging = np.sin(np.arange(40)[:, None, None] / 5 + rng.normal(size=(50, 3)))
    return (0.02 * swinging + 1e-4 * rng.normal(size=(40, 50, 3))).astype(np.float32)


@pytest.fixture(scope="module")
def rows(frames):
    source = Source("offsets", [frames, frames[:7]], frames, 1000)
    ways = candidates({4: Subspace.fitted(frames, 4)})
    return [measure(source, way, timed=False) for way in ways]


def test_bounds_hold(rows):
    assert {row.bound_mm for row in rows} == {None, 0.0, 0.1, 0.01, 0.001}
    for row in rows:
        assert row.bound_mm is None or row.largest_mm <= row.bound_mm, row.label


def test_bytes_are_counted(rows, frames):
    sizes = {(row.label, row.bound_mm): row for row in rows}
    raw = sizes["float32", 0.0]
    assert (raw.bytes_per_frame, raw.ratio) == (600, 1)
    assert sizes["`dsnet pack`", 0.1].ratio > sizes["`dsnet pack`", 0.01].ratio > 1
    assert sizes["4 directions alone", None].bytes_per_frame == 4 * 4 + 5 * 600 / 1000


def test_a_subspace_of_all_directions_is_exact(frames):
    subspace = Subspace.fitted(frames, 40)
    again = subspace.frames(subspace.coefficients(frames), frames.shape)
    np.testing.assert_allclose(again, frames, atol=1e-7)
    assert len(subspace.directions) == 39  # one is the mean's


def test_the_page_has_a_row_for_each(rows):
    facts = {"run": "r", "data": "synthetic", "clips": 2, "frames": 40, "machine": None}
    text = page({**facts, "rows": [vars(row) for row in rows]})
    assert text.count("\n| ") == len(rows) + 2  # and the head
    assert "synthetic" in text
