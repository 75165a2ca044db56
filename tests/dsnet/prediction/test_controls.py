"""What an animator asks of a moving body: gains, parts, shapes, the floor."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.parts import PARTS, part_weights
from bridge.body.posing import Smpl
from bridge.motion import Motion, pack_theta, unpack_theta
from dsnet.cli import main
from dsnet.prediction.controls import (
    Controls,
    controlled_body,
    leg_length_m,
    lowest_points_m,
    put_on_floor,
)
from dsnet.prediction.gains import Gains, gains_of_parts
from dsnet.prediction.load_model import TrainedModel
from dsnet.prediction.moving_body import MovingBody, place_motion
from dsnet.prediction.prediction_files import predict_motion
from dsnet.prediction.shapes import MeasuredBody
from tests.forged.amass import load_amass_motion
from tests.forged.cyclic import circling, save_on_the_spot

LAP = 30


@pytest.fixture
def character(soft: TrainedModel) -> TrainedModel:
    return soft


@pytest.fixture
def bouncing(tmp_path: Path) -> Motion:
    return load_amass_motion(save_on_the_spot(tmp_path / "given" / "bounce.npz", LAP + 1, LAP))


def offsets_of(moving: MovingBody) -> np.ndarray:
    return np.concatenate([posed.offsets_m for posed in moving])


def controlled(character: TrainedModel, motion: Motion, **asked) -> np.ndarray:
    return offsets_of(controlled_body(character, motion, Controls(**asked)))


def test_nothing_asked_is_the_motion_as_it_is(character, bouncing):
    plain = offsets_of(MovingBody(character, place_motion(bouncing, character.body)))
    np.testing.assert_array_equal(controlled(character, bouncing), plain)
    assert Controls().given() == {}


def test_a_motion_that_was_read_at_another_rate_is_refused(character, bouncing):
    controlled(character, bouncing, motion_fps=bouncing.source_fps)
    with pytest.raises(DsnetError, match=r"read with motion_fps=60\.0; expected it with 50"):
        controlled(character, bouncing, motion_fps=50.0)
    with pytest.raises(DsnetError, match=r"with smooth_hz=None; expected it with 8"):
        controlled(character, bouncing, smooth_hz=8.0)
    with pytest.raises(DsnetError, match=r"expected it with auto.*smooth_hz='auto'"):
        controlled(character, bouncing, smooth_hz="auto")
    with pytest.raises(DsnetError, match="at 30 frames a second; expected the 60"):
        controlled(character, replace(bouncing, fps=30.0))


def test_a_predictor_on_another_body_than_is_asked_for_is_refused(character, bouncing):
    with pytest.raises(DsnetError, match="body='embedded:male' with dsnet_plus on embedded:female"):
        controlled(character, bouncing, body=Path("embedded:male"))
    with pytest.raises(DsnetError, match="--gender male with embedded:female"):
        controlled(character, bouncing, gender="male")


def test_gain_multiplies_the_skin_alone(character, bouncing):
    one, half, none = (
        next(iter(controlled_body(character, bouncing, Controls(gain=gain))))
        for gain in (1.0, 0.5, 0.0)
    )
    np.testing.assert_array_equal(one.offsets_m, one.predicted_m)
    np.testing.assert_array_equal(half.offsets_m, 0.5 * one.offsets_m)
    assert not none.offsets_m.any()
    np.testing.assert_allclose(
        half.vertices_m - none.vertices_m, (one.vertices_m - none.vertices_m) / 2, atol=1e-6
    )


def test_the_gain_of_a_part_is_its_own(character):
    body = character.body
    asked = 2.0 * gains_of_parts(["belly=3", "arms=0", "hands=1"])
    gain = Gains(body, asked).unlimited[:, 0]
    weights = part_weights(body)
    expected = {"belly": 6.0, "forearms": 0.0, "hands": 2.0, "thighs": 2.0}
    for part, value in expected.items():
        inside = weights[:, PARTS.index(part)] > 0.999
        assert inside.sum() > 20
        np.testing.assert_allclose(gain[inside], value, atol=0.01)
    assert gain.min() >= 0.0
    assert gain.max() <= 6.0


def test_gains_of_parts_move_them_alone(character, bouncing):
    plain, more = (
        controlled(character, bouncing),
        controlled(character, bouncing, part_gain=("belly=2",)),
    )
    belly = part_weights(character.body)[:, PARTS.index("belly")]
    np.testing.assert_allclose(more[:, belly == 0], plain[:, belly == 0], rtol=1e-6)
    inside = plain[:, belly > 0.999]
    gain = np.einsum("tvx,tvx->t", more[:, belly > 0.999], inside) / np.square(inside).sum((1, 2))
    np.testing.assert_allclose(more[:, belly > 0.999], gain[:, None, None] * inside, atol=1e-6)
    assert gain.min() > 1.0
    assert gain.max() <= 2.0 + 1e-6


def test_a_loop_gives_one_lap_that_follows_on_itself(character, bouncing, capsys):
    moving = controlled_body(character, bouncing, Controls(loop=True))
    assert "the last frame of" in capsys.readouterr().err
    found = offsets_of(moving)
    assert len(found) == len(moving) == LAP
    steps = np.linalg.norm(np.diff(found, axis=0, append=found[:1]), axis=-1).max(axis=1)
    assert steps[-1] < 1.2 * steps[:-1].max()


def test_a_loop_with_a_cut_is_refused(character, bouncing):
    theta = bouncing.theta.copy()
    theta[10:20, -3] += 3.0
    with pytest.raises(DsnetError, match=r"--loop with .*bounce\.npz, which jumps at frame 10"):
        controlled_body(character, replace(bouncing, theta=theta), Controls(loop=True))


def test_shape_floor_and_betas_reach_the_body(character, bouncing):
    asked = Controls(shape=("height=175",), floor="shift")
    moving = controlled_body(character, bouncing, asked)
    assert MeasuredBody(character.body)(moving.motion.betas)["height"] == pytest.approx(
        175, abs=0.5
    )
    low = min(posed.vertices_m[..., 1].min() for posed in moving)
    assert abs(low) < 0.01
    betas = controlled_body(character, bouncing, Controls(betas="1" + ",0" * 9)).motion.betas
    np.testing.assert_array_equal(betas, [1.0] + [0.0] * 9)


@pytest.mark.parametrize("asked", [Controls(), Controls(betas="1" + ",0" * 9)])
def test_whose_a_files_betas_are_is_told_where_they_are_meant(character, bouncing, capsys, asked):
    a_mans = replace(bouncing, betas=TALL, gender="male")
    controlled_body(character, a_mans, asked)
    assert bool(capsys.readouterr().err) == (asked.betas is None)


def test_strides_of_betas_that_tell_no_legs_are_told(character, bouncing, capsys):
    a_mans = replace(bouncing, betas=TALL, gender="male")
    for floor in ("shift", "scale"):
        controlled_body(character, a_mans, Controls(shape=("tall",), floor=floor))
        assert ("whose legs walked" in capsys.readouterr().err) == (floor == "scale")


@pytest.mark.usefixtures("blank_strip")
def test_the_command_takes_and_records_them(plus_run, tmp_path, capsys):
    path = save_on_the_spot(tmp_path / "given" / "bounce.npz", LAP, LAP)
    out, betas = tmp_path / "out", "1,0,0,0,0,0,0,0,0,0"
    options = "--gain 2 --part-gain belly=2 arms=0.5 --floor scale --loop --betas"
    given = ["--run", "r", "--motion", str(path), "--out", str(out), *options.split(), betas]
    main(["predict", *given])
    asked: dict[str, Any] = {"gain": 2.0, "floor": "scale", "loop": True, "betas": betas}
    gains = ["belly=2", "arms=0.5"]
    made = json.loads((out / "manifest.json").read_text())
    assert made["controls"] == {**asked, "part_gain": gains}
    assert 1.0 <= made["least_gain"] <= 4.0
    assert f"lowered by strain, down to {made['least_gain']:g}" in capsys.readouterr().err
    controls = Controls(**asked, part_gain=tuple(gains))
    again = predict_motion(plus_run, path, tmp_path / "again", controls=controls)
    np.testing.assert_array_equal(again.array("offsets"), np.load(out / "offsets.npy"))


REFUSED = [
    ("--gain -1", "0 to 20"),
    ("--gain nan", "0 to 20"),
    ("--part-gain nose=2", "each of head, chest"),
    ("--part-gain belly=2 belly=3", "given before"),
    ("--part-gain belly", "a number, 0 to 20"),
    ("--part-gain belly=nan", "a number, 0 to 20"),
    ("--part-gain belly=1e6", "a number, 0 to 20"),
    ("--shape ,", "an empty --shape"),
    ("--shape height=300", "nearest has height=19"),
    ("--shape tall --betas 0,0,0,0,0,0,0,0,0,0", "--betas with --shape"),
    ("--betas 1,2", "10 finite numbers"),
]


@pytest.mark.usefixtures("plus_run")
@pytest.mark.parametrize(("options", "said"), REFUSED)
def test_what_cannot_be_is_one_line(bouncing, tmp_path, refusal, options, said):
    given = ["--motion", str(bouncing.source), "--out", str(tmp_path / "out"), *options.split()]
    assert said in refusal("predict", "--run", "r", *given)
    assert not list(tmp_path.glob("*out*"))


BODY = load_body_model("embedded:female")
OWN, TALL = np.zeros(10), np.r_[2.5, np.zeros(9)]
SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"


def posed_lowest_m(motion: Motion) -> np.ndarray:
    """(T,) over all vertices."""
    pose, trans = unpack_theta(motion.theta)
    return Smpl(BODY).person(motion.betas).pose(pose, trans)[..., 1].min(axis=1)


@pytest.fixture(scope="module")
def recorded() -> Motion:
    """As a file has it, of a person of mean shape: she walks a circle, then jumps."""
    theta = circling(60)
    times_s = np.arange(20) / 60
    air = np.repeat(theta[-1:], 20, axis=0)
    air[:, -2] += 1.6 * times_s - 4.905 * times_s**2 + 0.01
    walked = np.concatenate([theta, air])
    motion = Motion(walked, OWN, "female", 60.0, 60.0, Path("forged"))
    # Her own soles touch the floor at 0.
    placed = place_motion(motion, BODY)
    pose, trans = unpack_theta(walked)
    low = posed_lowest_m(placed).min()
    return replace(motion, theta=pack_theta(pose, trans - [0.0, low, 0.0]))


def test_few_vertices_find_the_lowest_point(recorded):
    placed = place_motion(recorded, BODY, TALL)
    np.testing.assert_allclose(lowest_points_m(placed, BODY), posed_lowest_m(placed), atol=2e-3)


@pytest.mark.parametrize("floor", ["shift", "scale"])
@pytest.mark.parametrize("betas", [TALL, -TALL], ids=["tall", "short"])
def test_another_body_stands_on_the_floor(recorded, floor, betas):
    placed = place_motion(recorded, BODY, betas)
    assert abs(posed_lowest_m(placed).min()) > 0.05
    stood = put_on_floor(placed, BODY, floor, OWN)
    assert abs(posed_lowest_m(stood).min()) < 0.005


def test_a_shift_is_one_number(recorded):
    """So who jumps is in the air as long as before."""
    placed = place_motion(recorded, BODY, TALL)
    moved = put_on_floor(placed, BODY, "shift", OWN).theta - placed.theta
    np.testing.assert_allclose(moved[:, -2], moved[0, -2], atol=1e-12)
    assert not moved[:, :-2].any()
    assert not moved[:, -1].any()


def test_one_bad_frame_does_not_lift_the_motion(recorded):
    theta = np.tile(recorded.theta, (3, 1))
    theta[100, -2] -= 0.4
    motion = replace(recorded, theta=theta)
    stood = put_on_floor(place_motion(motion, BODY, TALL), BODY, "shift", motion.betas)
    assert abs(np.delete(posed_lowest_m(stood), 100).min()) < 0.01


def test_strides_grow_with_the_legs(recorded):
    ratio = leg_length_m(BODY, TALL) / leg_length_m(BODY, OWN)
    assert ratio > 1.1
    before = place_motion(recorded, BODY)
    after = put_on_floor(place_motion(recorded, BODY, TALL), BODY, "scale", OWN)
    (_, own), (_, trans) = unpack_theta(before.theta), unpack_theta(after.theta)
    np.testing.assert_allclose(np.diff(trans, axis=0), ratio * np.diff(own, axis=0), atol=1e-12)


def test_her_own_body_keeps_her_strides(recorded):
    own = place_motion(recorded, BODY)
    scaled = put_on_floor(own, BODY, "scale", OWN)
    np.testing.assert_allclose(scaled.theta, own.theta, atol=3e-3)


def test_legs_that_are_none_are_refused(recorded):
    strange = replace(recorded, betas=np.r_[1e3, np.zeros(9)])
    with pytest.raises(DsnetError, match=r"--floor scale .*Pass --floor shift"):
        put_on_floor(place_motion(strange, BODY, TALL), BODY, "scale", strange.betas)


@pytest.mark.licensed
@pytest.mark.skipif(not SAMPLE.exists(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
@pytest.mark.parametrize("floor", ["shift", "scale"])
def test_a_recorded_motion_of_another_body_stands(floor):
    """She jumps: lowest where she lands, on her toes."""
    motion = load_amass_motion(SAMPLE)
    for betas in (None, TALL, -TALL):
        placed = place_motion(motion, BODY, betas)
        assert abs(posed_lowest_m(placed).min()) > 0.02
        low_m = posed_lowest_m(put_on_floor(placed, BODY, floor, motion.betas))
        assert -0.006 < low_m.min() < 0.001
        assert 0.0 < np.median(low_m[-18:]) < 0.04
        assert low_m.max() > 0.1
