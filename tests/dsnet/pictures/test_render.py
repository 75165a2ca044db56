"""Pictures: framing, colours, and what a picture of a body must show."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from bridge.body import load_body_model
from bridge.errors import DsnetError
from dsnet.pictures.panels import magnitude_colours, scale_top_m
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.pictures.skins import skin_of, srgb_to_linear

TETRAHEDRON = np.array([[-0.5, 0, -0.3], [0.5, 0, -0.3], [0, 0, 0.6], [0, 1.6, 0]])
FACES = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])


BALL = trimesh.creation.icosphere(3, 0.5)
GREY = (0.6, 0.6, 0.6)


def render(colour, height_px=60):
    camera = frame_camera([TETRAHEDRON], height_px=height_px, azimuth_deg=0.0)
    painted = np.tile(colour, (4, 1))
    return render_bodies([TETRAHEDRON], FACES, camera=camera, colours=[painted])


def render_balls(*centres_m, height_px=240, seen=1):
    """Grey balls; the camera is framed on the first `seen` of them."""
    balls = [BALL.vertices + centre_m for centre_m in centres_m]
    camera = frame_camera(balls[:seen], height_px=height_px, azimuth_deg=0.0)
    grey = [np.tile(GREY, (len(ball), 1)) for ball in balls]
    return render_bodies(balls, BALL.faces, camera=camera, colours=grey).astype(int)


def test_body_stands_in_the_middle_on_white_in_its_colour():
    picture = render((0.1, 0.2, 0.8)).astype(int)
    coloured = picture[..., 2] - picture[..., 0] > 40
    rows, columns = np.nonzero(coloured)
    assert abs(columns.mean() - picture.shape[1] / 2) < 0.12 * picture.shape[1]
    assert rows.min() < 20
    widths = coloured.sum(axis=1)
    # The tip is up: the picture is neither mirrored top to bottom nor lying down.
    assert widths[rows.min() : rows.min() + 8].max() < 0.5 * widths.max()
    assert (picture[:8, :8] == 255).all()


def test_equal_arguments_give_equal_pixels_in_any_thread():
    with ThreadPoolExecutor(4) as pool:
        pictures = list(pool.map(render, [GREY] * 8))
    for picture in pictures:
        np.testing.assert_array_equal(picture, pictures[0])


def test_a_larger_picture_shows_the_same():
    """Whatever the size of faces in pixels: none is left out, none is drawn where there is none."""
    shares = []
    for height_px in (120, 700):
        picture = render((0.1, 0.2, 0.8), height_px=height_px).astype(int)
        shares.append((picture[..., 2] - picture[..., 0] > 40).mean())
    assert shares[1] == pytest.approx(shares[0], rel=0.03)


def test_a_round_body_is_smooth_and_so_is_its_outline():
    picture = render_balls((0, 0, 0))[..., 0]
    centre = picture.shape[1] // 2
    y, x = np.indices(picture.shape)
    inside = np.hypot(x + 0.5 - centre, y + 0.5 - picture.shape[0] / 2) < 0.38 * picture.shape[0]
    for axis in (0, 1):
        both = inside & np.roll(inside, 1, axis)
        # A speck or a hole differs by dozens from its neighbours.
        assert np.abs(picture - np.roll(picture, 1, axis))[both].max() <= 6
    top = picture[: picture.shape[0] // 2]
    between = top[(top < 250) & (top > top.min() + 40)]
    assert len(np.unique(between)) > 10


def test_floor_carries_a_soft_shadow_away_from_the_lamp():
    floor = render_balls((0, 0.5, 0), (-30, 0, 0), height_px=300)[200:, :, 0]
    left, right = np.split(floor[:, : floor.shape[1] // 2 * 2], 2, axis=1)
    assert right[:, -20:].min() < 240 < left[:, :20].min()
    assert len(np.unique(right[:, -20:])) > 10


def test_without_embree_the_remedy_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(DsnetError, match="--write offsets,vertices"):
        render(GREY)


@given(seed=st.integers(0, 10**6), azimuth=st.floats(-180, 180), elevation=st.floats(-10, 40))
def test_camera_sees_every_body(seed, azimuth, elevation):
    rng = np.random.default_rng(seed)
    bodies = [rng.normal(size=(20, 3)) + rng.normal(scale=3, size=3) for _ in range(3)]
    camera = frame_camera(bodies, height_px=100, azimuth_deg=azimuth, elevation_deg=elevation)
    origin, target = camera.target_m + camera.away_m, camera.target_m
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    relative = np.concatenate(bodies) - origin
    depth = relative @ forward
    half_width = camera.pixel * camera.width_px / 2
    assert (np.abs(relative @ right) / depth <= half_width * 1.001).all()
    half_height = half_width * camera.height_px / camera.width_px
    up = np.cross(right, forward)
    assert (np.abs(relative @ up) / depth <= half_height * 1.05).all()


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


def test_a_skin_is_drawn_where_it_lies():
    """From the crown down: dark hair, skin, a dark top, skin, dark shorts."""
    body = load_body_model("embedded:female")
    camera = frame_camera([body.v_template], height_px=200, azimuth_deg=0.0, elevation_deg=0.0)
    picture = render_bodies(
        [body.v_template], body.faces, camera=camera, colours=[skin_of(body)]
    ).astype(int)
    heights_m = {"hair": 0.73, "forehead": 0.69, "top": 0.25, "belly": 0.12, "shorts": -0.05}
    seen = {}
    for part, height_m in heights_m.items():
        _, up, away = (
            np.array([0, height_m, 0.1]) - camera.target_m - camera.away_m
        ) @ camera.axes.T
        row = camera.height_px / 2 + up / away / camera.pixel
        seen[part] = picture[round(row), camera.width_px // 2]
    for part in ("hair", "top", "shorts"):
        assert seen[part].max() < 120, part
    for part in ("forehead", "belly"):
        red, green, blue = seen[part]
        assert red > green > blue > 60, part
    assert skin_of(replace(body, texture=None)) is None
