"""A scene has what `dsnet predict` writes, at any rate, and shape keys hold it."""

from __future__ import annotations

import numpy as np
import pytest

import dsnet
from bridge.motion import Motion
from bridge.motion.resampling import prepared
from dsnet.blender.flesh import ENOUGH_M, LARGEST_GAIN, KeyFit, SceneFlesh, flesh_beside, z_up
from tests.dsnet.blender.scenes import scene_armature


@pytest.fixture(scope="module")
def motion(walk: Motion) -> Motion:
    return scene_armature(walk).motion({})


@pytest.fixture(scope="module")
def flesh(motion: Motion) -> SceneFlesh:
    return flesh_beside(motion, "female", [])


def test_at_sixty_frames_a_second_it_is_the_prediction(motion: Motion, flesh: SceneFlesh) -> None:
    moving = dsnet.animate(prepared(motion), "female")
    vertices_m, offsets_m = moving.arrays()
    np.testing.assert_allclose(np.concatenate([*flesh.offsets()]), offsets_m, atol=1e-9)
    alone_m, most_m = (np.concatenate(each) for each in zip(*flesh.surfaces(), strict=True))
    share = 1 / LARGEST_GAIN
    places_m = (1 - share) * alone_m + share * most_m
    np.testing.assert_allclose(places_m, z_up(vertices_m), atol=3e-6)


@pytest.mark.parametrize(("fps", "at"), [(30.0, 2.0), (24.0, 2.5), (120.0, 0.5)])
def test_another_rate_takes_what_lies_between(motion: Motion, fps: float, at: float) -> None:
    other = SceneFlesh(dsnet.load_model("female"), prepared(motion, fps=fps))
    _, offsets_m = other.moving.arrays()
    found_m = np.concatenate([*other.offsets()])
    assert len(found_m) == len(other)
    for frame in (0, 1, 7, len(other) - 2):
        below, share = divmod(frame * at, 1)
        pair = offsets_m[int(below)], offsets_m[min(int(below) + 1, len(offsets_m) - 1)]
        np.testing.assert_allclose(found_m[frame], (1 - share) * pair[0] + share * pair[1],
                                   atol=1e-8)  # fmt: skip


def test_shape_keys_hold_every_frame(flesh: SceneFlesh) -> None:
    fit, pieces = KeyFit(), [*flesh.offsets()]
    for piece in pieces:
        fit.add(piece)
    found, offsets_m = fit.shapes(), np.concatenate(pieces)
    assert len(found.shapes_m) < len(offsets_m)
    assert np.abs(found.values).max() * LARGEST_GAIN <= 10.0 + 1e-5
    rebuilt_m = np.tensordot(found.values, found.shapes_m, 1)
    assert np.linalg.norm(rebuilt_m - offsets_m, axis=-1).max() < 1.1 * ENOUGH_M


def test_nothing_moves_without_flesh() -> None:
    fit = KeyFit()
    fit.add(np.zeros((3, 5, 3), np.float32))
    assert fit.shapes().shapes_m.shape == (0, 5, 3)
    assert fit.shapes().values.shape == (3, 0)
