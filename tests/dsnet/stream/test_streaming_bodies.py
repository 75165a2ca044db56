"""Frame by frame, bodies move as over the whole motion, whoever else is there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.posing import Smpl
from bridge.motion import unpack_theta
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.smoothing import StreamSmoother
from dsnet.prediction.models import DsnetModel, PlusModel, predict_whole
from dsnet.stream.streams import MovedBody, Stream
from tests.forged.swaying import swaying

BODY = load_body_model("embedded:female")
BETAS = np.linspace(-1, 1, 10)
TIMES_S = np.arange(80) / 60


def streamed(bodies: Stream, theta: np.ndarray, betas: np.ndarray) -> list[MovedBody]:
    """All frames of a motion."""
    who = bodies.join(betas)
    answers = [bodies.step({who: pose})[who] for pose in theta]
    repeated = min(bodies.latency_frames, len(theta) - 1)
    return [*answers[repeated:], *bodies.leave(who)]


def offsets_of(moved: list[MovedBody]) -> np.ndarray:
    return np.stack([body.offsets_m for body in moved])


def latents_of(moved: list[MovedBody]) -> np.ndarray:
    return np.stack([body.latents for body in moved if body.latents is not None])


def whole(predict, theta: np.ndarray, betas: np.ndarray = BETAS) -> np.ndarray:
    """Offsets of the whole motion at once, piece by piece between cuts."""
    pieces = [predict(theta[piece], betas).offsets_m for piece in pieces_between_cuts(theta)]
    return np.concatenate([offsets for piece in pieces for offsets in piece])


@pytest.fixture(scope="module")
def flesh_with_static_part(flesh):
    rng = np.random.default_rng(2)
    static = replace(
        flesh.static,
        by_pose_m=rng.normal(0, 1e-3, flesh.static.by_pose_m.shape).astype(np.float32),
        constant_m=rng.normal(0, 1e-3, flesh.static.constant_m.shape).astype(np.float32),
    )
    return replace(flesh, static=static, people_betas=BETAS[None].astype(np.float32))


@pytest.mark.parametrize("look_ahead", [0, 1, 2])
@pytest.mark.parametrize("frames", [1, 2, 3, 80])
def test_frame_by_frame_is_the_whole_motion(flesh, look_ahead, frames):
    model, theta = replace(flesh, look_ahead=look_ahead), swaying(TIMES_S[:frames])
    bodies = Stream(model, body=BODY)
    assert bodies.latency_frames == look_ahead
    assert bodies.latency_s == pytest.approx(look_ahead / 60)
    found = streamed(bodies, theta, BETAS)
    expected = whole(partial(predict_whole, PlusModel(model, BODY)), theta)
    np.testing.assert_allclose(offsets_of(found), expected, atol=1e-5)
    posed = Smpl(BODY).person(BETAS).pose(*unpack_theta(theta), expected)
    np.testing.assert_allclose([body.vertices_m for body in found], posed, atol=1e-5)
    assert np.abs(expected).max() > 5e-3 or frames < 80


@pytest.mark.parametrize("frames", [1, 3, 5, 60])
def test_smoothed_bodies_are_those_of_the_smoothed_poses_three_frames_later(flesh, frames):
    rng = np.random.default_rng(0)
    theta = swaying(TIMES_S[:frames]) + rng.normal(0, 1e-3, (frames, 69))
    bodies = Stream(flesh, body=BODY, smooth=True)
    assert bodies.latency_frames == Stream(flesh, body=BODY).latency_frames + 3
    smoother = StreamSmoother(60.0)
    calm = [pose for pose in map(smoother.push, theta) if pose is not None]
    calm = np.stack([*calm, *smoother.finish()])
    expected = whole(partial(predict_whole, PlusModel(flesh, BODY)), calm)
    np.testing.assert_allclose(offsets_of(streamed(bodies, theta, BETAS)), expected, atol=1e-5)


def test_the_static_part_is_that_of_the_pose_answered(flesh_with_static_part):
    theta = swaying(TIMES_S[:20])
    found = streamed(Stream(flesh_with_static_part, body=BODY), theta, BETAS)
    expected = whole(partial(predict_whole, PlusModel(flesh_with_static_part, BODY)), theta)
    np.testing.assert_allclose(offsets_of(found), expected, atol=1e-5)


@pytest.mark.parametrize("cuts", [(20,), (1, 2), (20, 21, 23), (79,)])
@pytest.mark.parametrize("look_ahead", [0, 2])
def test_after_a_cut_she_begins_anew(flesh, cuts, look_ahead):
    theta = swaying(TIMES_S)[: cuts[-1] + 20]
    for cut in cuts:
        theta[cut:, 66] += 0.7
    model = replace(flesh, look_ahead=look_ahead)
    found = streamed(Stream(model, body=BODY), theta, BETAS)
    expected = whole(partial(predict_whole, PlusModel(model, BODY)), theta)
    np.testing.assert_allclose(offsets_of(found), expected, atol=1e-5)


@pytest.mark.parametrize("unit_per_m", [1, 100])
def test_translations_in_centimetres_are_told_once(flesh, capsys, unit_per_m):
    theta = swaying(TIMES_S[:30])
    theta[:, 66] += 1.4 * TIMES_S[:30]  # she walks
    theta[:, 66:] *= unit_per_m
    streamed(Stream(flesh, body=BODY), theta, BETAS)
    told = capsys.readouterr().err.splitlines()
    assert ["in metres" in line for line in told] == [True] * (unit_per_m == 100)


@pytest.mark.parametrize(("each", "again"), [(1, None), (2, 18), (3, 24)])
@pytest.mark.parametrize("smooth", [False, True])
def test_poses_that_come_again_are_told_once(flesh, capsys, each, again, smooth):
    theta = swaying(TIMES_S)[np.arange(80) // each]
    streamed(Stream(flesh, body=BODY, smooth=smooth), theta, BETAS)
    told = [line for line in capsys.readouterr().err.splitlines() if "repeats" in line]
    assert len(told) == (again is not None)
    assert all(f"a streamed body repeats {again} of 40 poses" in line for line in told)


def test_who_joins_leaves_or_waits_disturbs_nobody(flesh):
    """Four persons, each there at other times; one is not named at every third step."""
    bodies = Stream(flesh, body=BODY)
    motions = [swaying(TIMES_S[: 14 + 7 * seed], seed) for seed in range(4)]
    shapes = np.random.default_rng(3).normal(0, 1, (4, 10))
    there: dict[int, tuple[int, Iterator[np.ndarray]]] = {}
    found: list[list[MovedBody]] = [[] for _ in motions]
    for step in range(64):
        if step % 6 == 0 and step // 6 < len(motions):
            joined = step // 6
            there[bodies.join(shapes[joined])] = joined, iter(motions[joined])
        poses = {}
        for who, (seed, motion) in list(there.items()):
            if seed == 2 and step % 3 == 0:
                continue
            pose = next(motion, None)
            if pose is None:
                found[seed].extend(bodies.leave(who))
                del there[who]
            else:
                poses[who] = pose
        for who, moved in bodies.step(poses).items():
            found[there[who][0]].append(moved)
    assert not there
    assert bodies.characters == ()
    for theta, betas, moved in zip(motions, shapes, found, strict=True):
        alone = streamed(Stream(flesh, body=BODY), theta, betas)
        together = moved[bodies.latency_frames :]
        np.testing.assert_allclose(offsets_of(together), offsets_of(alone), atol=1e-6)
        for one, other in zip(together, alone, strict=True):
            np.testing.assert_allclose(one.vertices_m, other.vertices_m, atol=1e-6)
        expected = whole(partial(predict_whole, PlusModel(flesh, BODY)), theta, betas)
        np.testing.assert_allclose(offsets_of(together), expected, atol=1e-5)


def broken(pose: np.ndarray, row: int, value: float) -> np.ndarray:
    pose = pose.copy()
    pose[row] = value
    return pose


POSE = swaying(TIMES_S[:1])[0]
REFUSED: dict[str, Any] = {
    "nan": broken(POSE, 5, np.nan),
    "inf": broken(POSE, 67, np.inf),
    "minus inf": broken(POSE, 0, -np.inf),
    "a turn of 1e4 rad": broken(POSE, 4, 1e4),
    "a kilometre off": broken(POSE, 66, 1001.0),
    "beyond float32": broken(POSE, 66, 1e300),
    "a batch": POSE[None],
    "SMPL's body pose": np.zeros(72),
    "a number": 0.0,
    "words": "stand",
    "nothing": None,
}


def test_poses_that_are_none_are_refused_and_nothing_has_moved(flesh):
    """One before each step, of the second of two characters; the first's is a pose."""
    theta = swaying(TIMES_S[: len(REFUSED)])
    disturbed, undisturbed = (Stream(flesh, body=BODY) for _ in range(2))
    pairs = [[bodies.join(BETAS) for _ in range(2)] for bodies in (disturbed, undisturbed)]
    for row, refused in enumerate(REFUSED.values()):
        pose: np.ndarray = theta[row]
        with pytest.raises(DsnetError, match=f"character {pairs[0][1]}") as no:
            disturbed.step({pairs[0][0]: pose, pairs[0][1]: refused})
        assert "\n" not in str(no.value)
        found, expected = (
            bodies.step(dict.fromkeys(pair, pose))
            for bodies, pair in zip((disturbed, undisturbed), pairs, strict=True)
        )
        for one, other in zip(found.values(), expected.values(), strict=True):
            np.testing.assert_array_equal(one.vertices_m, other.vertices_m)


@pytest.mark.parametrize(
    "betas", [np.full(10, np.nan), np.full(10, 1e10), np.full(10, 1e308), np.zeros(16), "tall"]
)
def test_a_shape_that_is_nobodys_is_refused(flesh, betas):
    bodies = Stream(flesh, body=BODY)
    with pytest.raises(DsnetError, match="betas"):
        bodies.join(betas)
    assert bodies.characters == ()


def test_who_is_not_there_is_refused(flesh):
    bodies = Stream(flesh, body=BODY)
    gone, stays = bodies.join(BETAS), bodies.join(BETAS)
    assert list(bodies.leave(gone)) == []
    for ask in (lambda: bodies.step({stays: POSE, gone: POSE}), lambda: bodies.leave(gone)):
        with pytest.raises(DsnetError, match=rf"character {gone}.*one of {stays}"):
            ask()
    assert bodies.join(BETAS) not in (gone, stays)
    assert bodies.step({}) == {}


def test_answers_and_arguments_are_the_callers_own(flesh):
    theta = swaying(TIMES_S[:6])
    kept = theta.copy()
    bodies = Stream(flesh, body=BODY)
    who = bodies.join(BETAS)
    for pose in theta:
        moved = bodies.step({who: pose})[who]
        moved.vertices_m[:] = moved.offsets_m[:] = pose[:] = np.nan
    last = streamed(Stream(flesh, body=BODY), kept, BETAS)[-1]
    np.testing.assert_array_equal(next(bodies.leave(who)).vertices_m, last.vertices_m)


def test_a_runs_best_predictor_by_its_name(plus_run, flesh):
    theta = swaying(TIMES_S[:5])
    by_name = streamed(Stream(plus_run.name), theta, BETAS)
    given = streamed(Stream(flesh, body=BODY), theta, BETAS)
    np.testing.assert_array_equal(offsets_of(by_name), offsets_of(given))
    assert by_name[0].latents is None
    with pytest.raises(DsnetError, match="'nope' of run"):
        Stream(plus_run.name, "nope")


def test_dsnet_gives_latents_too(trained_run, trained):
    """The paper's pipeline, with a cut: from no past again."""
    theta = swaying(TIMES_S[:40])
    theta[25:, 66] += 0.7
    bodies = Stream(trained_run.name, "dsnet_standardised")
    assert bodies.latency_frames == 0
    bodies.join(np.zeros(10))
    found = streamed(bodies, theta, BETAS)
    codec = trained_run.artifact("train-ae")
    predict = partial(predict_whole, DsnetModel(trained, codec, BODY))
    parts = [predict(theta[part], BETAS) for part in (slice(25), slice(25, None))]
    latents = np.concatenate([part.latents for part in parts if part.latents is not None])
    np.testing.assert_allclose(latents_of(found), latents, atol=1e-5)
    np.testing.assert_allclose(offsets_of(found), whole(predict, theta), atol=1e-5)


def test_a_model_needs_its_body(flesh):
    with pytest.raises(DsnetError, match="body="):
        Stream(flesh)
