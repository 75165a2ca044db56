"""Gains as far as flesh strains: no gain that may be asked for turns skin inside out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import dsnet
from bridge.body.parts import PARTS
from bridge.body.posing import shaped_vertices
from dsnet.prediction.gains import GAINS, LARGEST_STRAIN, Gains, gains_of_parts, limited_gains
from dsnet.prediction.moving_body import MovingBody

STRAINS = np.geomspace(1e-4, 3.0, 200)


def one_gain(gain: float, strains: NDArray) -> NDArray:
    """At one strain after another, in a part."""
    return limited_gains(np.full(len(strains), gain), strains)


@pytest.mark.parametrize("gain", [0.0, 0.3, 1.0])
def test_a_gain_of_at_most_one_multiplies(gain):
    np.testing.assert_array_equal(one_gain(gain, STRAINS), gain)


def test_more_gain_is_more_and_more_strain_is_more():
    left = np.stack([one_gain(gain, STRAINS) for gain in np.geomspace(1.0, 400.0, 60)])
    assert (np.diff(left, axis=0) >= 0).all()
    assert (np.diff(left * STRAINS, axis=1) > 0).all()


@pytest.mark.parametrize("gain", [1.5, 5.0, 400.0])
def test_a_gain_adds_a_strain_of_at_most_the_largest(gain):
    left = one_gain(gain, STRAINS)
    added = (left - 1.0) * STRAINS
    assert (added <= LARGEST_STRAIN / (1 + (STRAINS / LARGEST_STRAIN) ** 2)).all()
    np.testing.assert_allclose(left[0], gain, rtol=0.01)  # calm flesh has what was asked for


def test_it_is_smooth():
    """Differences of second order shrink with the square of the step."""
    for step in (1e-2, 1e-3):
        strains = np.arange(0.0, 1.0, step)
        bent = np.abs(np.diff(one_gain(5.0, strains), 2)).max() / step**2
        assert bent < 1500.0
    gains = np.array([one_gain(gain, STRAINS) for gain in (1.0, 1.0 + 1e-6)])
    assert np.abs(np.diff(gains, axis=0)).max() < 1.1e-6


def test_strain_is_that_of_edges():
    body = dsnet.load_body("embedded:female")
    rest, gains = body.v_template, Gains(body, 2.0)
    np.testing.assert_allclose(gains.strains(np.ones((2, *rest.shape))), 0.0, atol=1e-3)
    stretched = gains.strains(0.2 * rest[None])[0]
    assert (stretched > 0.2).all()
    assert (stretched < 0.2 * len(body.faces) ** (1 / 16) * 2).all()
    np.testing.assert_allclose(gains.strains(0.1 * rest[None])[0], stretched / 2, rtol=1e-4)


@pytest.fixture(scope="module", params=["female", "male"])
def landing(request) -> MovingBody:
    """A heavy person's."""
    motion = dsnet.load_motion("sample:jumping_jacks")
    return dsnet.animate(motion, shape="heavy", gender=request.param)


def test_no_gain_turns_a_surface_inside_out(landing):
    """Neither the largest one, nor that of a part on top; what a prediction folds stays out."""
    body, betas = landing.body, landing.motion.betas
    rest = shaped_vertices(body, betas[None])[0]
    predicted_m = np.concatenate([moved.predicted_m for moved in landing])[4::12].astype(np.float64)
    alone = [*triangles(rest, body.faces, predicted_m)]
    whole = np.min([facing for _, facing in alone], axis=0) > 0
    assert (~whole).sum() < 5
    longest = np.max([stretch for stretch, _ in alone])
    most = GAINS.most * gains_of_parts(["torso=20", "arms=20", "legs=20"])
    for asked in (3.0, 5.0, most):
        gains = Gains(body, asked)
        left = gains.left_of_parts(predicted_m) @ gains.shares.T
        for stretch, facing in triangles(rest, body.faces, predicted_m * left[..., None]):
            assert facing[whole].min() > 0
            assert stretch.max() < longest + LARGEST_STRAIN
    plain = Gains(body, 3.0).unlimited * predicted_m
    turned = [(facing[whole] < 0).sum() for _, facing in triangles(rest, body.faces, plain)]
    assert max(turned) > 20  # the blades that this is about


def triangles(
    rest: NDArray, faces: NDArray, offsets_m: NDArray
) -> Iterator[tuple[NDArray, NDArray]]:
    """Frame by frame the largest stretch of each triangle (F,), and the product of its normals
    before and after (F,)."""
    sides = _sides(rest[faces])
    flat = np.linalg.inv(np.linalg.qr(sides)[1])
    normal = np.cross(*np.moveaxis(sides, -1, 0))
    for frame_m in offsets_m:
        moved = _sides((rest + frame_m)[faces])
        stretch = np.linalg.svd(moved @ flat, compute_uv=False)[:, 0]
        yield stretch, (normal * np.cross(*np.moveaxis(moved, -1, 0))).sum(axis=1)


def _sides(corners: NDArray) -> NDArray:
    """(F, 3, 2) of triangles (F, 3, 3)."""
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)


def test_a_moving_body_has_the_gains_that_are_left():
    motion = dsnet.load_motion("sample:jumping_jacks").frames(slice(40, 70))
    asked = {"shape": "heavy", "gain": 2.0, "part_gain": ["chest=4"]}
    for moved in dsnet.animate(motion, **asked):
        assert moved.gains is not None
        assert moved.gains.shape == (len(moved), len(PARTS))
        chest, thighs = (moved.gains[:, PARTS.index(part)] for part in ("chest", "thighs"))
        assert chest.min() < 1.5  # of 8: she lands
        assert (thighs > 1.0).all()
        assert (thighs <= 2.0).all()
    for moved in dsnet.animate(motion, shape="heavy"):
        assert moved.gains is None
        np.testing.assert_array_equal(moved.offsets_m, moved.predicted_m)
