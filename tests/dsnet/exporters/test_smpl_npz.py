"""SMPL parameters and offsets, as AMASS's readers take them and as the paper has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model, pose_vertices
from bridge.body.vertex_order import vertex_order
from bridge.motion import load_motion, unpack_theta
from dsnet.exporters import smpl_npz
from dsnet.prediction.moving_body import MovingBody, place_motion
from tests.dsnet.exporters.conftest import FRAMES, moving_body
from tests.forged.bodies import person


@pytest.fixture(scope="module")
def path(performed, tmp_path_factory):
    path = tmp_path_factory.mktemp("npz") / "walk.npz"
    smpl_npz.write(path, performed.moving)
    return path


@pytest.fixture(scope="module")
def stored(path):
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def posed(body, stored, pose, trans_m):
    betas = np.tile(stored["betas"], (FRAMES, 1))
    return pose_vertices(body, betas, pose, trans_m, stored["offsets"])


def test_it_says_what_it_is(stored):
    texts = ("data", "up_axis", "theta_up_axis", "length_unit", "angle_unit", "gender")
    assert [str(stored[key]) for key in texts] == ["synthetic", "z", "y", "m", "rad", "female"]
    assert stored["mocap_framerate"] == 60.0
    assert str(stored["vertices"]) == vertex_order(load_body_model("embedded:female"))
    assert stored["poses"].shape == (FRAMES, 156)  # SMPL-H's joints
    assert stored["offsets"].dtype == np.float32


def test_theta_and_offsets_give_the_body_with_y_up(performed, stored):
    body = performed.moving.body
    vertices_m = posed(body, stored, *unpack_theta(stored["theta"]))
    np.testing.assert_allclose(vertices_m, performed.vertices_m, atol=1e-5)


def test_poses_and_offsets_give_the_body_with_z_up(performed, stored):
    body = performed.moving.body
    vertices_m = posed(
        body, stored, stored["poses"].reshape(FRAMES, 52, 3)[:, :24], stored["trans"]
    )
    x, y, z = np.moveaxis(performed.vertices_m, -1, 0)
    np.testing.assert_allclose(vertices_m, np.stack([x, -z, y], axis=-1), atol=1e-5)


def test_an_exported_motion_can_be_predicted_again(performed, path):
    motion = place_motion(load_motion(path), performed.moving.body)
    before, after = (unpack_theta(m.theta) for m in (performed.moving.motion, motion))
    np.testing.assert_allclose(after[1], before[1], atol=1e-9)
    turns = [Rotation.from_rotvec(pose.reshape(-1, 3)).as_matrix() for pose, _ in (before, after)]
    np.testing.assert_allclose(turns[1], turns[0], atol=1e-9)
    np.testing.assert_array_equal(motion.betas, performed.moving.motion.betas)
    assert motion.gender == "female"


def test_smplx_has_its_joints_and_nobody_elses_turns(performed, stored, tmp_path):
    path = tmp_path / "walk.npz"
    smpl_npz.write_smplx(path, performed.moving)
    with np.load(path) as archive:
        poses = archive["poses"]
    assert poses.shape == (FRAMES, 165)
    np.testing.assert_array_equal(poses[:, :66], stored["poses"][:, :66])
    assert not poses[:, 66:].any()
    assert not stored["poses"][:, 66:].any()
    read = load_motion(path)
    assert read.kind == performed.moving.body.kind == "smpl"
    motion = place_motion(read, performed.moving.body)
    np.testing.assert_allclose(motion.trans_m, performed.moving.motion.trans_m, atol=1e-9)


def test_fingers_jaw_and_eyes_are_kept(performed, tmp_path):
    rng, moving = np.random.default_rng(3), performed.moving
    others = rng.normal(0, 0.3, (FRAMES, 33, 3))
    motion = replace(moving.motion, hands_and_face=others)
    moved = MovingBody(moving.trained, motion)
    np.testing.assert_array_equal(moved.pose, motion.pose)  # SMPL's own skin has none of them
    for joints, kept in ((52, others[:, 3:]), (55, others)):
        path = tmp_path / f"{joints}.npz"
        smpl_npz.write(path, moved, joints)
        with np.load(path) as archive:
            poses = archive["poses"].reshape(FRAMES, joints, 3)
        np.testing.assert_array_equal(poses[:, 22:], kept)
        read = load_motion(path).hands_and_face
        assert read is not None
        turns = [Rotation.from_rotvec(one.reshape(-1, 3)) for one in (read, kept)]
        assert (turns[0].inv() * turns[1]).magnitude().max() < 1e-6


@pytest.mark.parametrize("others", [None, 30, 33])
def test_smpl_is_read_again(character, tmp_path, others):
    moving = moving_body(character, 8)
    if others:
        turns = np.random.default_rng(1).uniform(-1, 1, (8, others, 3))
        moving.motion = replace(moving.motion, hands_and_face=turns)
    moving.motion = replace(moving.motion, betas=np.ones(10))
    path = tmp_path / "walk.smpl"
    smpl_npz.write_smpl(path, moving)
    again = place_motion(load_motion(path), moving.body)
    np.testing.assert_allclose(again.trans_m, moving.motion.trans_m, atol=1e-9)
    assert not again.betas.any()  # an embedded body's are not SMPL's
    assert (again.gender, again.source_fps) == ("female", 60.0)
    both = [Rotation.from_rotvec(one.all_joints.reshape(-1, 3)) for one in (again, moving.motion)]
    assert (both[0].inv() * both[1]).magnitude().max() < 1e-6
    wanted = moving.motion.all_joints
    # SMPL's pelvis lies lower in its template.
    lower_m = 0.351 if others == 33 else 0.241
    with np.load(path) as arrays:
        assert arrays["smplVersion"] == (2 if others == 33 else 1)
        np.testing.assert_array_equal(arrays["bodyPose"], wanted[:, :22])
        if others:
            hands = np.concatenate([arrays["leftHandPose"], arrays["rightHandPose"]], axis=1)
            np.testing.assert_array_equal(hands, wanted[:, -30:])
        if others == 33:
            np.testing.assert_array_equal(arrays["headPose"], wanted[:, 22:25])
        lowered_m = arrays["bodyTranslation"] - moving.motion.trans_m
        np.testing.assert_allclose(lowered_m[:, 1], lower_m, atol=1e-4)


@pytest.mark.parametrize(
    ("kind", "others", "kept"),
    [("smpl", 30, True), ("smplh", 30, True), ("smpl", 33, False), ("smplh", 33, False),
     ("smplx", 30, True), ("smplx", 33, True)],
)  # fmt: skip
def test_smpl_has_betas_only_of_the_kind_that_is_written(character, tmp_path, kind, others, kept):
    moving = moving_body(character, 8)
    moving.trained = replace(moving.trained, other_body=replace(person(kind), gender="unknown"))
    hands_and_face = np.full((8, others, 3), 0.1)
    moving.motion = replace(moving.motion, betas=np.ones(10), hands_and_face=hands_and_face)
    smpl_npz.write_smpl(tmp_path / "walk.smpl", moving)
    with np.load(tmp_path / "walk.smpl") as arrays:
        assert arrays["shapeParameters"].tolist() == [float(kept)] * 10
        assert arrays["gender"] == 2  # the motion's, as the body has none
