"""What is shown is what is predicted, and the truth is shown only where it is one."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.runtime.moving_body import MovingBody
from bridge.view.performances import SMPL_ALONE, Asked, Clip, Performances
from bridge.view.repertoire import open_repertoire
from bridge.view.selection import ERRORS, Selection, Shown
from bridge.view.truth import TRUTH
from tests.bridge.view.conftest import FRAMES, JUMP

SHOWN = FRAMES - 10
"""Frames that have a truth."""


def clip_of(performances: Performances, asked: Asked) -> Clip:
    found = performances.clip(asked)
    assert found is not None
    return found


def moved(performances: Performances, asked: Asked, gain: float):
    """Offsets and vertices of all frames, as prediction and export make them."""
    motion = performances.motion(asked.take, asked.betas)
    body = MovingBody(performances.repertoire.open(asked.predictor), motion, gain)
    frames = list(body)
    return [np.concatenate([getattr(f, n) for f in frames]) for n in ("offsets_m", "vertices_m")]


@pytest.mark.parametrize("own", [True, False])
def test_it_is_the_motion_that_prediction_makes(performances, own):
    betas = performances.own_betas(JUMP) if own else (2.0, *np.zeros(9))
    asked = Asked(JUMP, "dsnet_plus", betas)
    performances.want([asked])
    assert performances.worker.wait(30)
    offsets_m, vertices_m = moved(performances, asked, 0.5)
    clip = clip_of(performances, asked)
    assert clip.complete
    assert len(clip.offsets_m) == SHOWN
    assert np.abs(clip.offsets_m).max() > 1e-3
    np.testing.assert_allclose(0.5 * clip.offsets_m, offsets_m, atol=1e-7)
    shown_m = performances.vertices_m(asked, slice(0, SHOWN), gain=0.5)
    np.testing.assert_allclose(shown_m, vertices_m, atol=1e-6)


def test_frames_that_are_not_there_yet_are_smpl_alone(performances):
    betas = performances.own_betas(JUMP)
    early = Performances(performances.repertoire)
    shown = Shown(early, Selection(JUMP, betas, ("dsnet_plus", SMPL_ALONE)))
    early.worker.stop()
    whole = clip_of(performances, Asked(JUMP, "dsnet_plus", betas))
    clip = clip_of(early, shown.asked[0])
    clip.offsets_m[:40], clip.offsets_m[40:], clip.ready = whole.offsets_m[:40], 0, 40
    predicted, alone = shown.posed(50)
    assert "57 % computed" in predicted.label
    np.testing.assert_array_equal(predicted.vertices_m, alone.vertices_m)
    predicted, alone = shown.posed(30)
    assert "computed" not in predicted.label
    assert np.abs(predicted.vertices_m - alone.vertices_m).max() > 1e-3


def test_errors_are_distances_to_the_true_mesh(performances):
    betas = performances.own_betas(JUMP)
    selection = Selection(JUMP, betas, (SMPL_ALONE, TRUTH), gain=3.0, colouring=ERRORS)
    shown = Shown(performances, selection)
    assert performances.worker.wait(30)
    # Skin that is turned and not stretched carries an offset with its length.
    expected_m = np.full(SHOWN, np.sqrt(3) * 0.01)
    errors_m = performances.errors_m(shown.asked[0], 3.0)
    assert errors_m is not None
    np.testing.assert_allclose(errors_m, expected_m, rtol=1e-3)
    assert performances.errors_m(shown.asked[1], 3.0) is None
    alone, true = shown.posed(20)
    assert alone.values_m is not None
    assert true.values_m is not None
    assert alone.values_m.mean() == pytest.approx(np.sqrt(3) * 0.01, rel=1e-3)
    assert true.values_m.max() == 0


@pytest.mark.parametrize("take", [JUMP, "50004_stand (trained on)"])
def test_another_shape_and_a_motion_without_one_have_no_truth(performances, take):
    betas = (0.0,) * 10 if take == JUMP else performances.own_betas(take)
    shown = Shown(performances, Selection(take, betas, ("dsnet_plus", TRUTH)))
    assert performances.worker.wait(30)
    assert [one.name for one in shown.posed(0)] == ["dsnet_plus"]
    assert performances.errors_m(shown.asked[0], 1.0) is None


def test_colours_are_sizes_of_what_is_shown(performances):
    chosen = Selection(JUMP, performances.own_betas(JUMP), ("dsnet_plus",), gain=2.0)
    shown = Shown(performances, chosen)
    assert performances.worker.wait(30)
    clip = clip_of(performances, shown.asked[0])
    (posed,) = shown.posed(20)
    expected_m = 2 * np.linalg.norm(clip.offsets_m[20], axis=-1)
    assert posed.values_m is not None
    np.testing.assert_allclose(posed.values_m, expected_m, rtol=1e-6)


def test_no_more_of_a_motion_is_shown_than_was_asked_for(run):
    short = Performances(open_repertoire(run, None), most_s=0.5)
    assert len(short.motion(JUMP).theta) == 30
    short.worker.stop()


def test_the_packaged_model_shows_samples_without_any_run():
    found = open_repertoire(None, None)
    assert (found.origin, list(found.predictors)) == ("synthetic", ["dsnet_plus"])
    assert {"dancing", "walking"} <= set(found.takes)
    assert found.read_truth is None
