"""What is shown is what is predicted, and the truth is shown only where it is one."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from bridge.body.parts import PARTS
from bridge.motion import load_amass_motion
from bridge.runtime.controls import Controls, blended_gain, controlled_body, gains_of_parts
from bridge.runtime.load_model import load_model
from bridge.runtime.moving_body import MovingBody
from bridge.view.performances import Asked, Clip, Gains, LatestWork, Performances, Way
from bridge.view.repertoire import SMPL_ALONE, TRUTH, open_repertoire
from bridge.view.selection import ERRORS, Selection, Shown
from tests.bridge.view.conftest import FRAMES, JUMP
from tests.forged.amass import save, smplh
from tests.forged.cyclic import save_on_the_spot

SHOWN = FRAMES - 10
"""Frames that have a truth."""


def clip_of(performances: Performances, asked: Asked) -> Clip:
    found = performances.clip(asked)
    assert found is not None
    return found


def moved(performances: Performances, asked: Asked, gain: float | np.ndarray):
    """Offsets and vertices of all frames, as prediction and export make them."""
    motion = performances.motion(asked.way)
    body = MovingBody(performances.repertoire.open(asked.predictor), motion, gain)
    frames = list(body)
    return [np.concatenate([getattr(f, n) for f in frames]) for n in ("offsets_m", "vertices_m")]


@pytest.mark.parametrize("own", [True, False])
def test_it_is_the_motion_that_prediction_makes(performances, own):
    betas = performances.own_betas(JUMP) if own else (2.0, *np.zeros(9))
    asked = Asked(Way(JUMP, betas), "dsnet_plus")
    performances.want([asked])
    assert performances.worker.wait(30)
    offsets_m, vertices_m = moved(performances, asked, 0.5)
    clip = clip_of(performances, asked)
    assert clip.complete
    assert len(clip.offsets_m) == SHOWN
    assert np.abs(clip.offsets_m).max() > 1e-3
    np.testing.assert_allclose(0.5 * clip.offsets_m, offsets_m, atol=1e-7)
    shown_m = performances.vertices_m(asked, slice(0, SHOWN), gains=Gains(0.5))
    np.testing.assert_allclose(shown_m, vertices_m, atol=1e-6)


def test_frames_that_are_not_there_yet_are_smpl_alone(performances):
    betas = performances.own_betas(JUMP)
    early = Performances(performances.repertoire)
    shown = Shown(early, Selection(JUMP, betas, ("dsnet_plus", SMPL_ALONE)))
    early.worker.stop()
    whole = clip_of(performances, Asked(Way(JUMP, betas), "dsnet_plus"))
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
    selection = Selection(JUMP, betas, (SMPL_ALONE, TRUTH), gains=Gains(3.0), colouring=ERRORS)
    shown = Shown(performances, selection)
    assert performances.worker.wait(30)
    # Skin that is turned and not stretched carries an offset with its length.
    expected_m = np.full(SHOWN, np.sqrt(3) * 0.01)
    errors_m = performances.errors_m(shown.asked[0], Gains(3.0))
    assert errors_m is not None
    np.testing.assert_allclose(errors_m, expected_m, rtol=1e-3)
    assert performances.errors_m(shown.asked[1], Gains(3.0)) is None
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
    assert performances.errors_m(shown.asked[0], Gains()) is None


def test_colours_are_sizes_of_what_is_shown(performances):
    chosen = Selection(JUMP, performances.own_betas(JUMP), ("dsnet_plus",), gains=Gains(2.0))
    shown = Shown(performances, chosen)
    assert performances.worker.wait(30)
    clip = clip_of(performances, shown.asked[0])
    (posed,) = shown.posed(20)
    expected_m = 2 * np.linalg.norm(clip.offsets_m[20], axis=-1)
    assert posed.values_m is not None
    np.testing.assert_allclose(posed.values_m, expected_m, rtol=1e-6)


def test_parts_have_their_own_gains(performances):
    body = performances.repertoire.body
    gains = Gains(2.0, tuple(3.0 if part == "belly" else 1.0 for part in PARTS))
    asked = Asked(Way(JUMP, performances.own_betas(JUMP)), "dsnet_plus")
    performances.want([asked])
    assert performances.worker.wait(30)
    gain = blended_gain(body, 2.0, gains_of_parts(["belly=3"]))
    np.testing.assert_array_equal(performances.gain(asked, gains)[:, 0], gain)
    _, vertices_m = moved(performances, asked, gain)
    shown_m = performances.vertices_m(asked, slice(0, SHOWN), gains)
    np.testing.assert_allclose(shown_m, vertices_m, atol=1e-6)


@pytest.mark.parametrize("floor", ["shift", "scale"])
def test_a_floor_moves_everybody_and_has_no_truth(performances, floor):
    way = Way(JUMP, (2.0, *np.zeros(9)), floor)
    shown = Shown(performances, Selection(JUMP, way.betas, (SMPL_ALONE, TRUTH), floor=floor))
    assert [asked.predictor for asked in shown.asked] == [SMPL_ALONE]
    low_m = performances.vertices_m(shown.asked[0], slice(0, SHOWN))[..., 1].min()
    assert abs(low_m) < 0.01
    assert not performances.knows_truth(Way(JUMP, performances.own_betas(JUMP), floor))


def test_a_loop_is_the_one_that_prediction_makes(tmp_path):
    path = save_on_the_spot(tmp_path / "given" / "bounce.npz", 31, 30)
    short = Performances(open_repertoire(None, path), most_s=0.3)
    asked = Asked(Way("bounce", short.own_betas("bounce"), loop=True), "dsnet_plus")
    short.want([asked])
    assert short.worker.wait(60)
    short.worker.stop()
    assert not short.worker.failed
    looped = controlled_body(load_model(None), load_amass_motion(path), Controls(loop=True))
    whole_m = np.concatenate([frames.vertices_m for frames in looped])
    assert len(whole_m) == 30
    shown_m = short.vertices_m(asked, slice(0, 18))
    assert len(shown_m) == 18
    np.testing.assert_allclose(shown_m, whole_m[:18], atol=1e-5)


def test_a_motions_rate_is_the_one_that_was_said(tmp_path, capsys):
    trans = np.zeros((61, 3))
    trans[:, 2] = 0.1 * np.abs(np.sin(7 * np.arange(61) / 60))
    path = save(tmp_path / "fast.npz", smplh(61, 180.0), trans=trans, marker_data=None)
    assert len(open_repertoire(None, path).takes["fast"].read(None).theta) == 21
    assert "fast.npz falls with" in capsys.readouterr().err
    mended = open_repertoire(None, path, Controls(motion_fps=60.0))
    assert len(mended.takes["fast"].read(None).theta) == 61
    assert capsys.readouterr().err == ""


def test_no_more_of_a_motion_is_shown_than_was_asked_for(run):
    short = Performances(open_repertoire(run, None), most_s=0.5)
    assert len(short.motion(Way(JUMP, short.own_betas(JUMP))).theta) == 30
    short.worker.stop()


def test_the_packaged_model_shows_samples_without_any_run():
    found = open_repertoire(None, None)
    assert (found.origin, list(found.predictors)) == ("synthetic", ["dsnet_plus"])
    assert {"dancing", "walking"} <= set(found.takes)
    assert found.read_truth is None


@pytest.fixture
def worker() -> Iterator[LatestWork]:
    found = LatestWork()
    yield found
    found.stop()


def test_work_is_done_in_order(worker):
    done: list[str] = []

    def work(name: str, steps: int) -> Iterator[None]:
        for _ in range(steps):
            yield
        done.append(name)

    worker.want({"a": lambda: work("a", 3), "b": lambda: work("b", 0)})
    assert worker.wait(5)
    assert done == ["a", "b"]


def test_what_is_under_way_is_dropped_or_goes_on(worker):
    begun, go, started = [], threading.Semaphore(0), threading.Event()

    def endless(name: str) -> Iterator[None]:
        begun.append(name)
        started.set()
        while True:
            go.acquire()
            yield

    def short() -> Iterator[None]:
        begun.append("short")
        yield

    worker.want({"a": lambda: endless("a")})
    assert started.wait(5)
    go.release()
    worker.want({"a": lambda: endless("a again")})
    go.release()
    worker.want({"short": short})
    go.release(2)
    assert worker.wait(5)
    assert begun == ["a", "short"]


def test_a_failure_is_kept_and_the_rest_is_done(worker):
    done = []

    def failing() -> Iterator[None]:
        yield
        raise ValueError("no")

    def fine() -> Iterator[None]:
        done.append("fine")
        yield

    worker.want({"bad": failing, "fine": fine})
    assert worker.wait(5)
    assert done == ["fine"]
    assert str(worker.failed["bad"]) == "no"
    worker.want({"bad": failing})
    assert worker.wait(5)
