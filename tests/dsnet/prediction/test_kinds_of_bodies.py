"""A motion of SMPL, SMPL-H or SMPL-X on a body of the same kind, or of another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body import BodyModelData, load_body_model
from bridge.motion import load_motion
from bridge.runs import read_artifact
from dsnet.cli import main
from dsnet.exporters.clip_pictures import RenderedClip
from dsnet.exporters.output import facts_in_a_line
from dsnet.pictures.panels import footer
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.moving_body import place_motion
from dsnet.view.clip_list import ClipList
from dsnet.view.page import clip_of
from dsnet.view.scene import Scene
from tests.dsnet.view.pages import track_m
from tests.forged.amass import save, smplx
from tests.forged.bodies import PELVIS_M, person

UPRIGHT = Rotation.from_euler("x", -90, degrees=True).as_matrix()
"""From z up to y up."""
OF_SMPLX_M = np.array([0.003, -0.351, 0.012])
BODIES = {
    "smpl": person("smpl"),
    "smplx": replace(
        person("smplx"), v_template=person("smplx").v_template + OF_SMPLX_M - PELVIS_M
    ),
    "embedded": load_body_model("embedded:female"),
}


def of_smpl(path: Path, up: str, **changes: Any) -> Path:
    """Somebody who stands, turned about the vertical."""
    trans = np.random.default_rng(1).normal(size=(6, 3))
    heading = Rotation.from_euler(up, 40, degrees=True).as_matrix()
    root = Rotation.from_matrix(heading @ (UPRIGHT.T if up == "z" else np.eye(3))).as_rotvec()
    poses = np.zeros((6, 72))
    poses[:, :3] = root
    given = {"poses": poses, "trans": trans, "betas": np.zeros(10), "mocap_framerate": 60.0}
    return save(path, given, **changes)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("up", ["y", "z"])
def test_the_pelvis_is_where_the_files_own_kind_has_it(tmp_path, up, name):
    motion = load_motion(of_smpl(tmp_path / "a.npz", up))
    body = BODIES[name]
    placed = place_motion(motion, body)
    trans = np.random.default_rng(1).normal(size=(6, 3))
    expected = (trans + PELVIS_M) @ (UPRIGHT.T if up == "z" else np.eye(3))
    np.testing.assert_allclose(placed.trans_m + body.joints[0], expected, atol=1e-4)


def test_the_pelvis_of_this_projects_files_is_the_embedded_bodies(tmp_path):
    motion = load_motion(of_smpl(tmp_path / "a.npz", "y", source="synthetic"))
    placed = place_motion(motion, BODIES["smplx"])
    np.testing.assert_allclose(placed.trans_m + OF_SMPLX_M, motion.trans_m, atol=1e-4)


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("name", BODIES)
def test_a_file_that_tells_no_kind_is_the_bodys_or_smpls(tmp_path, name, up):
    said = load_motion(of_smpl(tmp_path / "a.npz", up))
    kind = {"smplx": "smplx"}.get(name, "smpl")
    unsaid = load_motion(of_smpl(tmp_path / "b.npz", up, poses=said_poses(tmp_path)))
    assert unsaid.kind is None
    expected = place_motion(replace(said, kind=kind), BODIES[name])
    np.testing.assert_allclose(place_motion(unsaid, BODIES[name]).theta, expected.theta, atol=1e-9)


def said_poses(folder: Path) -> NDArray[np.float64]:
    """(T, 66) those of the 22 joints that every kind has."""
    with np.load(folder / "a.npz") as stored:
        return stored["poses"][:, :66]


@pytest.mark.parametrize("name", BODIES)
def test_the_place_of_the_joint_itself_is_the_same_on_all(tmp_path, name):
    """As BVHs and files of joints have it, which are of no kind."""
    read = load_motion(of_smpl(tmp_path / "a.npz", "y"))
    motion = replace(read, kind=None, trans_of="joint")
    placed = place_motion(motion, BODIES[name])
    np.testing.assert_allclose(placed.trans_m + BODIES[name].joints[0], motion.trans_m, atol=1e-9)


def posed(body: BodyModelData, rest_m: NDArray, pose: NDArray, trans: NDArray) -> NDArray:
    """(V, 3) by SMPL's formula: chained joints, then skinning by weights."""
    joints, turns = body.joints, Rotation.from_rotvec(pose).as_matrix()
    rotations, places = np.empty_like(turns), np.empty_like(joints)
    for joint, parent in enumerate(body.parents):
        above, at = (rotations[parent], places[parent]) if joint else (np.eye(3), joints[0])
        bone = joints[joint] - joints[parent] if joint else np.zeros(3)
        rotations[joint], places[joint] = above @ turns[joint], at + above @ bone
    features = (turns[1:] - np.eye(3)).ravel()
    rest_m = rest_m + body.posedirs @ features
    each = np.einsum("jxy,vjy->vjx", rotations, rest_m[:, None] - joints) + places
    return np.einsum("vj,vjx->vx", body.weights, each) + trans


def test_hands_jaw_and_eyes_are_posed_where_the_file_poses_them(tmp_path):
    body = BODIES["smplx"]
    body.save_smpl_npz(tmp_path / "SMPLX_FEMALE.npz")
    motion = smplx(8, 60.0) | {"betas": np.zeros(10)}
    motion["poses"][:, 66:] = np.random.default_rng(2).normal(0, 0.3, (8, 99))
    motion["trans"] += np.arange(24).reshape(8, 3) / 100
    save(tmp_path / "in" / "a.npz", motion)
    main([
        "predict", "--motion", str(tmp_path / "in" / "a.npz"), "--out", str(tmp_path / "out"),
        "--body", str(tmp_path / "SMPLX_FEMALE.npz"), "--write", "offsets,vertices",
    ])  # fmt: skip
    made = read_artifact(tmp_path / "out")
    poses = motion["poses"].reshape(8, 55, 3)
    at_rest = poses.copy()
    at_rest[:, 22:] = 0
    for frame, offsets_m in enumerate(made.array("offsets")):
        rest_m, trans = body.v_template + offsets_m, motion["trans"][frame]
        expected, still = (
            posed(body, rest_m, pose[frame], trans) @ UPRIGHT.T for pose in (poses, at_rest)
        )
        np.testing.assert_allclose(made.array("vertices")[frame], expected, atol=1e-5)
        assert np.abs(expected - still).max() > 0.02


def test_hands_are_no_flesh_in_pages_and_clips(tmp_path):
    """What is shown without offsets has the fingers where they are posed."""
    BODIES["smplx"].save_smpl_npz(tmp_path / "SMPLX_FEMALE.npz")
    motion = smplx(4, 60.0) | {"betas": np.zeros(10)}
    motion["poses"][:, 75:] = 0.6
    path, asked = save(tmp_path / "a.npz", motion), Controls(body=tmp_path / "SMPLX_FEMALE.npz")
    trained, loaded = asked.load(None, None, path)
    moving, alone = (controlled_body(trained, loaded, replace(asked, gain=g)) for g in (1.0, 0.0))
    alone_m = np.concatenate([part.vertices_m for part in alone])
    clip = RenderedClip([moving], fps=60.0, body_px=64)
    np.testing.assert_allclose(clip._pose_alone(2), alone_m[2], atol=1e-6)
    clip, truth = clip_of(moving)
    shown = ClipList(trained, {trained.name: ""}, lambda name: trained, {"a": clip}, truth=truth)
    body_m = (
        track_m(Scene(shown).assets["track0_smpl"](), moving.body.vertex_count)
        + moving.motion.trans_m[:, None]
    )
    np.testing.assert_allclose(body_m, alone_m, atol=1e-3)
    assert trained.shows == "synthetic flesh"
    assert "licensed" in footer(trained.shows)
    assert facts_in_a_line(moving).startswith("synthetic flesh data")
