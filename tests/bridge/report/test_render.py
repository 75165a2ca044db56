"""Pictures: framing, colours, and what a picture of a body must show."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from bridge.report.motion_strip import draw_motion_strip
from bridge.report.panels import magnitude_colours, scale_top_m
from bridge.report.render import frame_camera, linear_to_srgb, render_bodies, srgb_to_linear

TETRAHEDRON = np.array([[-0.5, 0, -0.3], [0.5, 0, -0.3], [0, 0, 0.6], [0, 1.6, 0]])
FACES = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])[:, ::-1]


def render(colour, **changes):
    camera = frame_camera([TETRAHEDRON], height_px=60, azimuth_deg=0.0)
    painted = np.tile(colour, (4, 1))
    return render_bodies(
        [TETRAHEDRON], FACES, camera=camera, colours=[painted], samples=4, **changes
    )


def test_body_stands_in_the_middle_on_white_in_its_colour():
    picture = render((0.1, 0.2, 0.8)).astype(int)
    coloured = picture[..., 2] - picture[..., 0] > 40
    rows, columns = np.nonzero(coloured)
    assert abs(columns.mean() - picture.shape[1] / 2) < 0.12 * picture.shape[1]
    assert rows.min() < 20
    widths = coloured.sum(axis=1)
    # The tip is up: the picture is neither mirrored top to bottom nor lying down.
    assert widths[rows.min() : rows.min() + 8].max() < 0.5 * widths.max()
    assert picture[:8, :8].mean() > 245


def test_equal_arguments_give_equal_pixels():
    np.testing.assert_array_equal(render((0.5, 0.5, 0.5)), render((0.5, 0.5, 0.5)))


def test_the_renderers_threads_leave_each_others_pixels_alone(monkeypatch):
    """Before anything is rounded: a sum in another order is rarely seen in a picture's bytes."""
    rendered = []
    keep = lambda one: rendered.append(np.array(one))  # noqa: E731
    monkeypatch.setattr("bridge.report.render.developed", keep)
    camera = frame_camera([TETRAHEDRON], height_px=200)
    for _ in range(6):
        render_bodies([TETRAHEDRON], FACES, camera=camera, samples=4)
    for one in rendered[1:]:
        np.testing.assert_array_equal(one, rendered[0])


def test_floor_carries_a_shadow():
    picture = render((0.9, 0.9, 0.9))
    assert picture[-20:].min() < 225


@given(seed=st.integers(0, 10**6), azimuth=st.floats(-180, 180), elevation=st.floats(-10, 40))
def test_camera_sees_every_body(seed, azimuth, elevation):
    rng = np.random.default_rng(seed)
    bodies = [rng.normal(size=(20, 3)) + rng.normal(scale=3, size=3) for _ in range(3)]
    camera = frame_camera(bodies, height_px=100, azimuth_deg=azimuth, elevation_deg=elevation)
    origin, target = np.array(camera.origin_m), np.array(camera.target_m)
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    relative = np.concatenate(bodies) - origin
    depth = relative @ forward
    half_width = np.tan(np.radians(camera.field_of_view_deg) / 2)
    assert (np.abs(relative @ right) / depth <= half_width * 1.001).all()
    half_height = half_width * camera.height_px / camera.width_px
    up = np.cross(right, forward)
    assert (np.abs(relative @ up) / depth <= half_height * 1.05).all()


@given(value=st.floats(0, 1))
def test_srgb_round_trip(value):
    np.testing.assert_allclose(linear_to_srgb(srgb_to_linear(value)), value, atol=1e-4)


def test_colours_grow_darker_with_magnitude():
    colours = magnitude_colours(np.linspace(0, 0.03, 20), 0.02)
    lightness = srgb_to_linear(colours) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness[:13]) < 0).all()
    np.testing.assert_array_equal(colours[-1], colours[-2])


@pytest.mark.parametrize(
    ("largest_m", "top_m"), [(0.0143, 0.015), (0.02, 0.02), (0.0061, 0.008), (0.0, 1e-4)]
)
def test_colour_scale_ends_at_a_round_number(largest_m, top_m):
    assert scale_top_m(np.full(10, largest_m)) == pytest.approx(top_m)


def test_motion_strip_of_few_frames(tmp_path):
    bodies = TETRAHEDRON + np.array([[[4.0 * t, 0, 2.0 * t]] for t in range(3)])
    path = tmp_path / "strip.png"
    draw_motion_strip(
        path, bodies, 0.01 * np.ones_like(bodies), FACES,
        origin="synthetic", width_px=150, samples=4,
    )  # fmt: skip
    picture = np.asarray(Image.open(path).convert("RGB"), dtype=int)
    assert picture.shape[1] > 1.5 * picture.shape[0]
    strong = np.ptp(picture, axis=-1).max(axis=0) > 80
    # Three bodies and the colour bar: four runs of coloured columns at least.
    assert np.count_nonzero(np.diff(strong.astype(int)) == 1) >= 4
