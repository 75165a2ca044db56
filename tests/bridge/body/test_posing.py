"""Posing: the oracle against closed forms, and the fast path against the oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model, pose_vertices
from bridge.body.posing import Smpl, rest_vertices, shaped_joints, shaped_vertices
from dsnet.verify.reference.smpl import unposed_vertices

SEEDS = st.integers(0, 2**32 - 1)


def random_arguments(
    seed: int, count: int = 3, joints: int = 24, angle: float = 0.5
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    pose = rng.normal(scale=angle, size=(count, joints, 3))
    return rng.normal(size=(count, 10)), pose, rng.normal(size=(count, 3))


def test_zero_pose_gives_template_plus_shape(female: BodyModelData) -> None:
    betas, pose, trans = random_arguments(0)
    expected = female.v_template + np.einsum("vxs,bs->bvx", female.shapedirs, betas)
    posed = pose_vertices(female, betas, 0 * pose, trans)
    np.testing.assert_allclose(posed, expected + trans[:, None], atol=1e-12)


@given(seed=SEEDS, joints=st.sampled_from([22, 24]))
def test_unpose_inverts_pose(small_body: BodyModelData, seed: int, joints: int) -> None:
    betas, pose, trans = random_arguments(seed, joints=joints, angle=0.3)
    offsets = np.random.default_rng(seed).normal(scale=0.05, size=(3, 60, 3))
    posed = pose_vertices(small_body, betas, pose, trans, offsets)
    unposed = unposed_vertices(small_body, posed, betas, pose, trans)
    expected = rest_vertices(small_body, betas, pose) + offsets
    np.testing.assert_allclose(unposed, expected, atol=1e-7)


@given(seed=SEEDS, angle=st.sampled_from([1e-7, 1.0, np.pi - 1e-6]))
def test_turning_the_root_turns_the_body_about_the_pelvis(
    small_body: BodyModelData, seed: int, angle: float
) -> None:
    betas, pose, trans = random_arguments(seed)
    direction = np.random.default_rng(seed + 1).normal(size=3)
    turn = Rotation.from_rotvec(angle * direction / np.linalg.norm(direction))
    turned = pose.copy()
    turned[:, 0] = (turn * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    pelvis = shaped_joints(small_body, betas)[:, :1] + trans[:, None]
    before = pose_vertices(small_body, betas, pose, trans) - pelvis
    after = pose_vertices(small_body, betas, turned, trans) - pelvis
    np.testing.assert_allclose(after, before @ turn.as_matrix().T, atol=1e-9)


def test_batch_equals_singles(small_body: BodyModelData) -> None:
    betas, pose, trans = random_arguments(2, count=4)
    batch = pose_vertices(small_body, betas, pose, trans)
    singles = [
        pose_vertices(small_body, betas[i : i + 1], pose[i : i + 1], trans[i : i + 1])[0]
        for i in range(4)
    ]
    np.testing.assert_allclose(batch, singles, atol=1e-12)


def test_one_vertex_by_hand(small_body: BodyModelData) -> None:
    """Eq. 1-2 for vertex 7, bone by bone, with every product written out."""
    betas, pose, trans = random_arguments(3, count=1)
    rotations = Rotation.from_rotvec(pose[0]).as_matrix()
    joints = small_body.J_regressor.toarray() @ shaped_vertices(small_body, betas)[0]
    features = np.concatenate([(rotation - np.eye(3)).ravel() for rotation in rotations[1:]])
    rest = shaped_vertices(small_body, betas)[0, 7] + small_body.posedirs[7] @ features
    expected = trans[0].copy()
    for joint in range(24):
        point, ancestor = rest, joint
        while ancestor >= 0:
            point = rotations[ancestor] @ (point - joints[ancestor]) + joints[ancestor]
            ancestor = small_body.parents[ancestor]
        expected += small_body.weights[7, joint] * point
    np.testing.assert_allclose(pose_vertices(small_body, betas, pose, trans)[0, 7], expected)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("betas", np.zeros((2, 11))),
        ("pose", np.zeros((2, 21, 3))),
        ("trans", np.zeros((1, 3))),
        ("offsets", np.zeros((2, 59, 3))),
    ],
)
def test_wrong_shapes_are_named(small_body: BodyModelData, name: str, value: np.ndarray) -> None:
    arguments = {
        "betas": np.zeros((2, 10)),
        "pose": np.zeros((2, 24, 3)),
        "trans": np.zeros((2, 3)),
        "offsets": np.zeros((2, 60, 3)),
        name: value,
    }
    with pytest.raises(DsnetError, match=name):
        pose_vertices(small_body, **arguments)


@pytest.mark.parametrize("joints", [22, 24])
def test_posed_vertices_are_the_oracles(joints):
    rng = np.random.default_rng(joints)
    body, betas = load_body_model("embedded:female"), rng.normal(size=10)
    pose, trans = rng.normal(0, 0.7, (4, joints, 3)), rng.normal(0, 3, (4, 3))
    pose[0] = 0
    offsets = rng.normal(0, 0.01, (4, body.vertex_count, 3)).astype(np.float32)
    kept = offsets.copy()
    found = Smpl(body).person(betas).pose(pose, trans, offsets)
    expected = pose_vertices(body, np.tile(betas, (4, 1)), pose, trans, offsets)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=5e-6)  # 2^-24 of 10 m, and sums of 24 bones
    np.testing.assert_array_equal(offsets, kept)


def test_several_persons_are_posed_as_each_alone(monkeypatch):
    monkeypatch.setattr("bridge.body.posing._FRAMES_AT_ONCE", 4)
    rng = np.random.default_rng(3)
    body, betas = load_body_model("embedded:female"), rng.normal(size=(11, 10))
    pose, trans = rng.normal(0, 0.7, (11, 22, 3)), rng.normal(0, 3, (11, 3))
    offsets = rng.normal(0, 0.01, (11, body.vertex_count, 3)).astype(np.float32)
    kept, skin = offsets.copy(), Smpl(body)
    found = skin.pose([skin.person(shape) for shape in betas], pose, trans, offsets)
    np.testing.assert_allclose(found, pose_vertices(body, betas, pose, trans, offsets), atol=5e-6)
    np.testing.assert_array_equal(offsets, kept)


def test_some_vertices_are_placed_and_turned_as_among_all():
    rng, chosen = np.random.default_rng(5), np.arange(3, 6890, 50)
    body, betas = load_body_model("embedded:female"), rng.normal(size=10)
    pose, trans = rng.normal(0, 0.7, (70, 22, 3)), rng.normal(0, 3, (70, 3))
    person = Smpl(body, chosen, np.float64).person(betas)
    places, turns = person.skin(pose, trans)
    shapes = np.tile(betas, (70, 1))
    expected = pose_vertices(body, shapes, pose, trans)[:, chosen]
    np.testing.assert_allclose(places, expected, atol=1e-6)  # weights sum to 1 to seven digits
    np.testing.assert_allclose(person.pose(pose, trans), places, atol=1e-12)
    pushed = np.broadcast_to([0.0, 0.0, 1.0], (70, body.vertex_count, 3))
    moved = pose_vertices(body, shapes, pose, trans, pushed)[:, chosen] - expected
    np.testing.assert_allclose(turns[..., 2], moved, atol=1e-6)
    still, unturned = person.skin(np.zeros((1, 22, 3)), np.zeros((1, 3)))
    np.testing.assert_array_equal(unturned[0], np.broadcast_to(np.eye(3), unturned[0].shape))
    np.testing.assert_allclose(still[0].T, person.rest_m, atol=1e-12)


def test_a_shape_of_sixteen_numbers_is_refused():
    with pytest.raises(DsnetError, match="betas"):
        Smpl(load_body_model("embedded:female")).person(np.zeros(16))
