"""BVH as our reader and another one find it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import joint_rotations, shaped_joints
from bridge.motion import load_motion, pack_theta, unpack_theta
from dsnet.exporters import bvh
from dsnet.prediction.moving_body import MovingBody, place_motion
from tests.dsnet.exporters.conftest import FRAMES


@pytest.fixture(scope="module")
def path(performed, tmp_path_factory):
    path = tmp_path_factory.mktemp("bvh") / "body.bvh"
    bvh.write(path, performed.moving)
    return path


def angles_rad(one, other):
    """Of every joint's rotation, axis-angle, from another's."""
    turns = [Rotation.from_rotvec(np.reshape(pose, (-1, 3))) for pose in (one, other)]
    return (turns[0].inv() * turns[1]).magnitude()


def test_our_reader_gives_pose_and_place_back(performed, path):
    moving = performed.moving
    again = load_motion(path)
    assert again.notes == ()
    assert again.source_fps == 60.0
    assert angles_rad(again.pose, moving.motion.pose).max() < 1e-4
    placed = place_motion(again, moving.body)
    np.testing.assert_allclose(placed.trans_m, moving.motion.trans_m, atol=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_any_pose_comes_back_also_where_two_axes_fall_together(performed, tmp_path, seed):
    """Legs and trunk stay, by which a reader knows what is up and forward."""
    rng = np.random.default_rng(seed)
    pose, trans_m = np.zeros((9, 22, 3)), rng.uniform(-2, 2, 3) + rng.normal(0, 0.01, (9, 3))
    pose[:, 12:] = rng.uniform(-1.5, 1.5, (10, 3)) + rng.normal(0, 0.01, (9, 10, 3))
    pose[:5, 18] = [np.pi / 2, 0, 0]
    pose[5:, 18] = [np.pi / 2 - 1e-7, 0, 0]
    moving = performed.moving
    motion = replace(moving.motion, theta=pack_theta(pose, trans_m))
    bvh.write(tmp_path / "any.bvh", MovingBody(moving.trained, motion))
    again = place_motion(load_motion(tmp_path / "any.bvh"), moving.body)
    assert angles_rad(again.pose, pose).max() < 1e-4
    np.testing.assert_allclose(again.trans_m, trans_m, atol=1e-4)


def test_the_root_is_where_readers_have_it_that_add_its_offset(path):
    """As three.js does; Blender does not."""
    assert "ROOT pelvis\n{\nOFFSET 0.000000 0.000000 0.000000\n" in path.read_text()


def test_another_reader_finds_the_joints_where_smpl_has_them(performed, path):
    pybvh = pytest.importorskip("pybvh")
    other, (moving, body) = (
        pybvh.read_bvh_file(str(path)),
        (performed.moving, performed.moving.body),
    )
    assert (other.frame_count, other.fps) == (FRAMES, 60)
    pose, trans_m = unpack_theta(moving.motion.theta)
    joints_m = shaped_joints(body, moving.motion.betas[None])[0]
    world, places_m = [joint_rotations(body, pose)[:, 0]], [trans_m + joints_m[0]]
    for joint in range(1, len(joints_m)):
        parent = body.parents[joint]
        bone_m = world[parent] @ (joints_m[joint] - joints_m[parent])
        places_m.append(places_m[parent] + bone_m)
        world.append(world[parent] @ joint_rotations(body, pose)[:, joint])
    rows = [SMPL_JOINT_NAMES.index(name) for name in other.joint_names]
    found_m = other.joint_positions()
    np.testing.assert_allclose(found_m, np.stack(places_m, axis=1)[:, rows], atol=1e-5)
