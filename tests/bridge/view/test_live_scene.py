"""Every face has one colour, that of the mean over its corners."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.report.panels import MAGNITUDE_COLOURS

pytest.importorskip("viser", reason="viser is not installed")
from bridge.view.live_scene import BANDS, COLOURS, faces_by_band, own_vertices


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.1))
def test_every_face_is_in_the_one_band_of_its_value(seed, full_m):
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, 50, (80, 3)).astype(np.uint32)
    values_m = rng.uniform(0, 1.5 * full_m, 50)
    found = faces_by_band(faces, values_m, full_m)
    assert sorted(map(tuple, np.concatenate(found).tolist())) == sorted(map(tuple, faces.tolist()))
    edges_m = np.linspace(0.0, full_m, BANDS + 1)
    for band, own in enumerate(found):
        means = values_m[own].mean(axis=-1)
        assert (means >= edges_m[band] - 1e-9).all()
        if band < BANDS - 1:
            assert (means <= edges_m[band + 1] + 1e-9).all()


def test_no_value_has_the_first_colour():
    faces = np.arange(6, dtype=np.uint32).reshape(2, 3)
    assert [len(own) for own in faces_by_band(faces, np.zeros(6), 0.02)] == [2] + 9 * [0]


def test_colours_are_the_reports():
    report = 255 * np.asarray(MAGNITUDE_COLOURS(np.linspace(0, 1, BANDS)))[:, :3]
    np.testing.assert_allclose(COLOURS, report, atol=3.0)


def test_faces_have_the_same_corners_among_their_own_vertices():
    faces = np.array([[7, 2, 5], [5, 2, 9]], np.uint32)
    own, among_own = own_vertices(faces, 12)
    assert own.tolist() == [2, 5, 7, 9]
    np.testing.assert_array_equal(own[among_own], faces)
    assert among_own.dtype == np.uint32
