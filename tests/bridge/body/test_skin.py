"""The pictures of skin lie on the embedded bodies, eyes in the eyes, and only on these bodies."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from bridge.body import BodyModelData, load_body_model
from bridge.body.embedded import EMBEDDED_GENDERS
from bridge.body.model_data import Texture
from bridge.body.skin import skin_png, split_at_seams

SOCKETS = [402, 3849]
"""The innermost vertices of both eyes."""


@pytest.fixture(scope="module", params=EMBEDDED_GENDERS)
def body(request: pytest.FixtureRequest) -> BodyModelData:
    return load_body_model(f"embedded:{request.param}")


@pytest.fixture(scope="module")
def picture(body: BodyModelData) -> NDArray:
    png = skin_png(body)
    assert png is not None
    assert len(png) < 200_000
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float) / 255


def corner_colours(body: BodyModelData, picture: NDArray) -> NDArray:
    """(F, 3, 3) of the texels at the faces' corners."""
    assert body.texture is not None
    size = len(picture)
    x, y = (body.texture.places[body.texture.corners] * [size, -size] + [0, size]).T
    return picture[y.astype(int).clip(0, size - 1), x.astype(int).clip(0, size - 1)].swapaxes(0, 1)


def test_pupils_are_black_in_white_eyes(body: BodyModelData, picture: NDArray) -> None:
    assert body.texture is not None
    size = len(picture)
    for vertex in SOCKETS:
        corners = body.texture.corners[(body.faces == vertex).any(axis=1)]
        assert len(corners) == 3
        places = (body.texture.places[corners] * [size, -size] + [0, size]).reshape(-1, 2)
        (left, top), (right, bottom) = np.round([places.min(axis=0), places.max(axis=0)]).astype(
            int
        )
        eye = picture[top:bottom, left:right]
        assert (eye.max(axis=-1) < 0.25).sum() > 5
        assert (eye.min(axis=-1) > 0.65).sum() > 5


def test_what_a_body_wears(body: BodyModelData, picture: NDArray) -> None:
    """By the colours at vertices near the joints."""
    colours = np.zeros((body.vertex_count, 3))
    colours[body.faces] = corner_colours(body, picture)
    hips = np.abs(body.v_template[:, 1] - body.joints[1, 1] + 0.02) < 0.04
    hips &= np.abs(body.v_template[:, 0]) < 0.2
    assert (colours[hips].max(axis=1) < 0.9).all()
    assert np.median(colours[hips].max(axis=1)) < 0.4  # dark shorts
    calves = body.weights[:, 4] > 0.9
    skin = np.median(colours[calves], axis=0)
    assert skin[0] > skin[1] > skin[2] > 0.4
    crown = body.v_template[:, 1] > body.v_template[:, 1].max() - 0.03
    assert (colours[crown].max(axis=1) < 0.4).all()  # hair


def test_places_are_on_the_picture(body: BodyModelData) -> None:
    assert body.texture is not None
    assert body.texture.places.min() >= 0
    assert body.texture.places.max() <= 1


def test_others_have_none(body: BodyModelData) -> None:
    assert body.texture is not None
    assert skin_png(replace(body, source="licensed")) is None
    assert skin_png(replace(body, texture=None)) is None
    turned = Texture(body.texture.places, body.texture.corners[::-1])
    assert skin_png(replace(body, texture=turned)) is None


def test_a_split_mesh_is_the_body_with_copies_behind(body: BodyModelData) -> None:
    assert body.texture is not None
    split = split_at_seams(body.faces, body.texture)
    count = body.vertex_count
    np.testing.assert_array_equal(split.vertex[:count], np.arange(count))
    assert 0 < len(split.vertex) - count < 0.15 * count
    np.testing.assert_array_equal(split.vertex[split.faces], body.faces)
    expected = body.texture.places[body.texture.corners]
    np.testing.assert_array_equal(split.places[split.faces], expected)
