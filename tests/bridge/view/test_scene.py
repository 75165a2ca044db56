"""What a page is given: tracks to a fortieth of a millimetre, and nothing of a licensed body."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.body import pose_vertices
from bridge.body.posing import rest_vertices
from bridge.motion import unpack_theta
from bridge.motion.loops import close_lap
from bridge.runtime.moving_body import MovingBody
from bridge.verify.reference.smpl import unposed_vertices
from bridge.view.page import document
from bridge.view.repertoire import open_repertoire
from bridge.view.scene import STEP_M, TRACK_FRAMES, Scene, _way_back
from tests.bridge.view.conftest import JUMP
from tests.bridge.view.pages import facts_of, numbers, track_m


@pytest.fixture(scope="module")
def repertoire(run):
    return open_repertoire(run, None)


def test_a_truth_of_another_pose_stands_where_it_stood(repertoire):
    take, read = repertoire.takes[JUMP], repertoire.read_truth
    true = read(take.truth)
    turned = true.theta.copy()
    turned[:, 50] += 0.3
    moved = replace(repertoire, read_truth=lambda _: replace(true, theta=turned))
    found_m = track_m(Scene(moved).assets["track0_truth"]())
    frames = [0, 33, len(true.theta) - 1]
    betas = np.tile(true.betas, (len(frames), 1))
    world_m = pose_vertices(
        repertoire.body, betas, *unpack_theta(turned[frames]), true.offsets_m[frames]
    )
    pose, trans_m = unpack_theta(take.read().theta[frames])
    rest_m = rest_vertices(repertoire.body, betas, pose)
    expected_m = unposed_vertices(repertoire.body, world_m, betas, pose, trans_m) - rest_m
    assert np.abs(expected_m).max() > 0.05
    np.testing.assert_allclose(found_m[frames], expected_m, atol=0.51 * STEP_M)


def test_where_the_graph_may_not_go_places_are_baked(repertoire):
    scene = Scene(replace(repertoire, body_model="SMPL_FEMALE.npz", origin="licensed"))
    facts = facts_of(scene)
    assert "licence" in facts["baked"]
    assert {"model", "shapes", "loop0"}.isdisjoint(scene.assets)
    assert {"graph", "bone_weight", "root_joint"}.isdisjoint(facts)
    motion = repertoire.takes[JUMP].read()
    motion = replace(motion, theta=motion.theta[: repertoire.takes[JUMP].frames])
    moved_m = np.concatenate(
        [part.vertices_m for part in MovingBody(repertoire.open("dsnet_plus"), motion)]
    )
    alone_m = track_m(scene.assets["track0_smpl"]()) + motion.theta[:, None, -3:]
    found_m = alone_m + track_m(scene.assets["track0_dsnet_plus"]())
    np.testing.assert_allclose(found_m, moved_m, atol=1.1 * STEP_M)


def test_a_loop_leads_back_to_its_first_round():
    theta = np.zeros((40, 69))
    turns = np.arange(40) * 2 * np.pi / 40
    theta[:, 1], theta[:, 66], theta[:, 68] = 0.01 * turns, 0.1 * turns, 0.02 * np.sin(turns)
    lap = close_lap(theta, np.array([0.0, 0.9, 0.1]))
    rounds = lap.repeated(4)
    back = np.array(_way_back(lap, 3))
    places_m = rounds[..., -3:] + lap.root_joint_m
    returned_m = places_m[3 * len(lap.theta) :] @ back[:9].reshape(3, 3).T + back[9:]
    assert abs(lap.turn_rad) > 0.01
    np.testing.assert_allclose(returned_m, places_m[: len(lap.theta)], atol=1e-12)


def test_what_cannot_be_looped_is_a_line():
    scene = Scene(open_repertoire(None, Path("sample:dancing")))
    assert "jerks" in json.loads(scene.assets["loop0"]())["failed"]


def test_long_motions_with_tracks_are_cut_and_say_so(repertoire):
    motion = repertoire.takes[JUMP].read()
    long = replace(motion, theta=np.tile(motion.theta, (20, 1)))
    take = replace(repertoire.takes[JUMP], read=lambda: long, truth=None, frames=None)
    scene = Scene(replace(repertoire, takes={"long": take}, body_model="SMPL.npz"))
    given = json.loads(scene.assets["motion0"]())
    assert given["count"] == TRACK_FRAMES
    assert numbers(given["theta"], "<f8").size == 69 * TRACK_FRAMES
    assert "left out" in given["says"][-1]


def test_a_file_asks_for_nothing_and_cannot_break_out_of_its_line(repertoire):
    page = document(Scene(repertoire), '"><script>alert(1)</script>')
    assert "connect-src 'none'" in page
    assert "<script>alert" not in page
    assert "@CONNECT@" not in page.partition("<style>")[0]
    assert "Copyright" in page
    assert "Microsoft" in page
