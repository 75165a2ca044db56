"""What a page is given: tracks to a fortieth of a millimetre, and nothing of a licensed body."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.body import pose_vertices
from bridge.body.posing import rest_vertices
from bridge.body.skin import skin_png
from bridge.motion import load_motion, unpack_theta
from dsnet.evaluation.pipelines import MotionArrays
from dsnet.prediction.controls import Controls, controlled_body, root_joint_m
from dsnet.prediction.load_model import load_model
from dsnet.prediction.loops import close_loop
from dsnet.prediction.moving_body import MovingBody, place_motion
from dsnet.verify.reference.smpl import unposed_vertices
from dsnet.view.clip_list import Clip, open_clip_list
from dsnet.view.page import document, write
from dsnet.view.scene import STEP_M, TRACK_FRAMES, Scene, cycles_around
from tests.dsnet.view.conftest import JUMP
from tests.dsnet.view.pages import facts_of, numbers, track_m


@pytest.fixture(scope="module")
def clip_list(run):
    return open_clip_list(run, None)


class TurnedTruth(MotionArrays):
    """One whose people turned otherwise than alignment found."""

    def frames(self, array, name, frames, vertices=slice(None)):
        turned = super().frames(array, name, frames, vertices).copy()
        if array == "theta":
            turned[:, 50] += 0.3
        return turned


def test_a_truth_of_another_pose_stands_where_it_stood(clip_list):
    clip, sequence = clip_list.clips[JUMP], "50004_jump"
    true = TurnedTruth(**vars(clip_list.truth))
    found_m = track_m(Scene(replace(clip_list, truth=true)).assets["track0_truth"]())
    frames = np.array([0, 33, true.sequences[sequence].length - 1])
    betas = np.tile(true.betas(sequence), (len(frames), 1))
    theta = true.frames("theta", sequence, frames)
    offsets_m = true.offsets_m(sequence, slice(None))[frames]
    world_m = pose_vertices(clip_list.best.body, betas, *unpack_theta(theta), offsets_m)
    pose, trans_m = unpack_theta(clip.read().theta[frames])
    rest_m = rest_vertices(clip_list.best.body, betas, pose)
    expected_m = unposed_vertices(clip_list.best.body, world_m, betas, pose, trans_m) - rest_m
    assert np.abs(expected_m).max() > 0.05
    np.testing.assert_allclose(found_m[frames], expected_m, atol=0.51 * STEP_M)


def licensed(clip_list, **more):
    """The same, of a body that may not be in a page."""
    body = replace(clip_list.best.body, source="licensed")
    return replace(clip_list, best=replace(clip_list.best, other_body=body), **more)


def test_a_runs_own_synthetic_body_lives(clip_list):
    """Its file is no embedded body's name, and needs no licence."""
    best = replace(clip_list.best, body_model="runs/r/corpus/SMPL_FEMALE.npz")
    assert "model" in Scene(replace(clip_list, best=best)).assets


def test_where_the_graph_may_not_go_places_are_baked(clip_list):
    scene = Scene(licensed(clip_list))
    facts = facts_of(scene)
    assert facts["origin"] == "synthetic flesh"
    assert "licence" in facts["baked"]
    assert {"skin", "runtime", "model", "shapes", "loop0"}.isdisjoint(scene.assets)
    assert {"graph", "root_joint", "root_joint_shapes"}.isdisjoint(facts)
    assert (numbers(facts["bone_weight"], "<f4") == 1).all()
    motion = clip_list.clips[JUMP].read()
    motion = motion.frames(slice(clip_list.truth.sequences["50004_jump"].length))
    moved_m = np.concatenate(
        [part.vertices_m for part in MovingBody(clip_list.open("dsnet_plus"), motion)]
    )
    alone_m = track_m(scene.assets["track0_smpl"]()) + motion.theta[:, None, -3:]
    found_m = alone_m + track_m(scene.assets["track0_dsnet_plus"]())
    np.testing.assert_allclose(found_m, moved_m, atol=1.1 * STEP_M)


def test_a_skin_lies_on_the_faces(clip_list):
    scene, body = Scene(clip_list), clip_list.best.body
    facts = facts_of(scene)["skin"]
    assert scene.assets["skin"]() == skin_png(body)
    vertex = np.concatenate([np.arange(body.vertex_count), numbers(facts["copy_of"], "<u2")])
    faces = numbers(facts["faces"], "<u2").reshape(-1, 3)
    np.testing.assert_array_equal(vertex[faces], body.faces)
    places = numbers(facts["places"], "<u2").reshape(-1, 2) / 65535
    np.testing.assert_allclose(places[faces], body.texture.places[body.texture.corners], atol=1e-6)


def test_rounds_lead_to_a_lap_that_stands_where_it_stood():
    theta = np.zeros((40, 69))
    turns = np.arange(40) * 2 * np.pi / 40
    theta[:, 1], theta[:, 66], theta[:, 68] = 0.01 * turns, 0.1 * turns, 0.02 * np.sin(turns)
    lap = close_loop(theta, np.array([0.0, 0.9, 0.1]))
    assert abs(lap.turn_rad) > 0.01
    rounds, count = cycles_around(lap, 2, 8), len(lap.theta)
    np.testing.assert_allclose(rounds[2 * count :], lap.repeated(2)[: count + 8], atol=1e-12)
    heading = np.unwrap(rounds[:, 1])
    turned_rad = heading[count : 2 * count] - heading[:count]
    np.testing.assert_allclose(turned_rad, lap.turn_rad, atol=1e-12)
    # Laid on from its own first round, the same: each ends where the next begins.
    first = replace(lap, theta=rounds[:count])
    np.testing.assert_allclose(first.repeated(3)[:, -3:], rounds[: 3 * count, -3:], atol=1e-12)


@pytest.mark.parametrize("trans_of", ["z", "y", "joint"])
def test_the_root_of_another_shape_stands_where_predict_has_it(clip_list, trans_of):
    body, motion = clip_list.best.body, clip_list.clips[JUMP].read()
    motion = replace(motion, trans_of=trans_of)
    scene = Scene(replace(clip_list, clips={"a": Clip(lambda: motion)}))
    by_joint = np.array(json.loads(scene.assets["motion0"]())["by_joint"])
    shapes = np.eye(10)[:2] * [[3.0], [-2.0]]
    one, other = (root_joint_m(body, betas) for betas in shapes)
    placed, moved = (place_motion(motion, body, betas).trans_m[0] for betas in shapes)
    np.testing.assert_allclose(by_joint @ (other - one), moved - placed, atol=1e-9)
    assert (np.abs(moved - placed).max() > 1e-4) == (trans_of != "y")


def test_what_cannot_be_looped_is_a_line():
    scene = Scene(open_clip_list(None, Path("sample:dancing")))
    assert "jerks" in json.loads(scene.assets["loop0"]())["failed"]


def test_long_motions_with_tracks_are_cut_and_say_so(clip_list):
    motion = clip_list.clips[JUMP].read()
    long = replace(motion, theta=np.tile(motion.theta, (20, 1)))
    clip = replace(clip_list.clips[JUMP], read=lambda: long, sequence="")
    scene = Scene(licensed(clip_list, clips={"long": clip}))
    given = json.loads(scene.assets["motion0"]())
    assert given["count"] == TRACK_FRAMES
    assert numbers(given["theta"], "<f8").size == 69 * TRACK_FRAMES
    assert "left out" in given["says"][-1]


def test_a_file_asks_for_nothing_and_cannot_break_out_of_its_line(clip_list):
    page = document(Scene(clip_list), '"><script>alert(1)</script>')
    assert "connect-src 'none'" in page
    assert "<script>alert" not in page
    assert "@CONNECT@" not in page.partition("<style>")[0]
    assert "Copyright" in page
    assert "Microsoft" in page


@pytest.mark.parametrize("skin", ["textured", "plain"])
def test_a_file_has_the_picture_of_skin_unless_it_shall_be_plain(tmp_path, skin):
    motion = load_motion("sample:walking").frames(slice(2))
    moving = controlled_body(load_model("female"), motion, Controls())
    moving.plain = skin == "plain"
    write(tmp_path / "a.html", moving)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert ('id="asset:skin"' in text) == (skin == "textured")
