"""The embedded bodies are closed, human, and the ones that were committed."""

from __future__ import annotations

import hashlib
from importlib import resources

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model, pose_vertices
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices

ASSETS = resources.files("bridge.body") / "assets"
STATURE_M = {"female": (1.50, 1.82), "male": (1.60, 1.95)}


def as_mesh(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False)


def shaped(data: BodyModelData, **betas: float) -> np.ndarray:
    vector = np.zeros((1, 10))
    for name, value in betas.items():
        vector[0, int(name.removeprefix("beta_"))] = value
    return shaped_vertices(data, vector)[0]


def waist_girth_m(data: BodyModelData, vertices: np.ndarray) -> float:
    """Perimeter of the convex hull of a slice of the torso between the lower spine joints."""
    height = data.J_regressor[3] @ vertices[:, 1]
    torso = data.weights[:, [0, 3, 6, 9]].sum(axis=1) > 0.9
    ring = vertices[torso & (np.abs(vertices[:, 1] - height) < 0.03)]
    return float(ConvexHull(ring[:, [0, 2]]).area)


def test_checksums_are_the_committed_ones() -> None:
    lines = (ASSETS / "SHA256SUMS").read_text().splitlines()
    assert len(lines) == 5
    for line in lines:
        digest, name = line.split()
        assert hashlib.sha256((ASSETS / name).read_bytes()).hexdigest() == digest


def test_assets_are_small_and_carry_their_licence() -> None:
    for gender in STATURE_M:
        assert len((ASSETS / f"embedded_{gender}.npz").read_bytes()) <= 1.5e6
    assert "CC0" in (ASSETS / "NOTICE.md").read_text()


def test_pictures_of_skin_lie_on_it_without_tears(body: BodyModelData) -> None:
    assert body.texture is not None
    places, corners = body.texture
    assert 0 <= places.min() <= places.max() <= 1
    assert len(np.unique(corners)) == len(places)
    on_picture, on_skin = (
        np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
        for triangles in (places[corners], body.v_template[body.faces])
    )
    # Corners that lie across a seam are drawn to the next one: as NOTICE.md says, of 1 in 100.
    torn = (np.diff(np.sort(corners, axis=1), axis=1) == 0).any(axis=1)
    assert 0.005 < torn.mean() < 0.01
    assert np.quantile((on_picture / on_skin)[~torn], 0.99) < 2.1
    assert (on_picture < 3 * on_skin).mean() > 0.995
    sides = places[corners[:, 1:]] - places[corners[:, :1]]
    areas = np.linalg.det(sides) / 2
    assert (areas > 0).mean() > 0.98
    # Each vertex has one place, but at seams.
    pairs = np.unique(np.stack([body.faces.ravel(), corners.ravel()]), axis=1)
    assert len(pairs.T) < 1.12 * body.vertex_count


def test_mesh_is_closed_with_the_sizes_of_smpl(body: BodyModelData) -> None:
    assert body.v_template.shape == (6890, 3)
    assert body.faces.shape == (13776, 3)
    mesh = as_mesh(body.v_template, body.faces)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.body_count == 1
    assert mesh.volume > 0, "faces must wind counter-clockwise seen from outside"


def test_both_bodies_share_their_topology(female: BodyModelData, male: BodyModelData) -> None:
    np.testing.assert_array_equal(female.faces, male.faces)
    ours, theirs = (
        np.load(str(ASSETS / f"embedded_{gender}.npz"))["makehuman_index"]
        for gender in ("female", "male")
    )
    np.testing.assert_array_equal(ours, theirs)
    assert np.abs(female.v_template - male.v_template).max() > 0.02


def test_weights_and_regressor_are_sparse_and_sum_to_one(body: BodyModelData) -> None:
    np.testing.assert_allclose(body.weights.sum(axis=1), 1.0, atol=1e-12)
    assert (body.weights >= 0).all()
    assert (body.weights > 0).sum(axis=1).max() <= 4
    assert ((body.weights > 0.3).sum(axis=0) > 10).all(), "every joint must move some skin"
    np.testing.assert_allclose(body.J_regressor.sum(axis=1), 1.0, atol=1e-12)
    assert np.diff(body.J_regressor.indptr).max() <= 96


def test_joints_of_one_side_do_not_move_the_other(body: BodyModelData) -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        joints = [name.startswith(side) for name in SMPL_JOINT_NAMES]
        other_side = body.v_template[:, 0] * sign < -0.05
        assert body.weights[np.ix_(other_side, np.flatnonzero(joints))].max() == 0.0


def test_tpose_axes_and_origin(body: BodyModelData) -> None:
    joints: dict[str, np.ndarray] = dict(zip(SMPL_JOINT_NAMES, body.joints, strict=True))
    np.testing.assert_allclose(joints["pelvis"], 0.0, atol=2e-3)
    assert joints["head"][1] > 0.4 > -0.7 > joints["left_ankle"][1]
    assert joints["left_foot"][2] > joints["left_ankle"][2] + 0.1, "toes point to +z"
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = np.array([joints[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist")])
        assert (np.diff(arm[:, 0]) * sign > 0.2).all()
        np.testing.assert_allclose(arm[:, 1:], arm[:1, 1:] + np.zeros((3, 2)), atol=5e-3)


def test_joints_lie_inside_the_middle_of_the_limbs(body: BodyModelData) -> None:
    """The surface around a limb joint is about as far away on opposite sides."""
    for name in ("knee", "elbow", "wrist", "ankle"):
        for side in ("left", "right"):
            index = SMPL_JOINT_NAMES.index(f"{side}_{name}")
            joint = body.joints[index]
            along = 0 if name in ("elbow", "wrist") else 1
            near = np.linalg.norm(body.v_template - joint, axis=1) < 0.12
            ring = body.v_template[near & (np.abs(body.v_template - joint)[:, along] < 0.02)]
            across = [axis for axis in range(3) if axis != along]
            below, above = ring[:, across].min(axis=0), ring[:, across].max(axis=0)
            position = (joint[across] - below) / (above - below)
            assert (position > 0.2).all(), (side, name, position)
            assert (position < 0.8).all(), (side, name, position)


def test_first_beta_is_stature(body: BodyModelData) -> None:
    statures_m = [np.ptp(shaped(body, beta_0=value)[:, 1]) for value in (-2.0, 0.0, 2.0)]
    low, high = STATURE_M[body.gender]
    assert low - 0.03 < statures_m[0] < statures_m[1] - 0.1
    assert statures_m[1] + 0.1 < statures_m[2] < high + 0.03


def test_later_betas_change_girth_and_volume_at_equal_stature(body: BodyModelData) -> None:
    """Some component makes the body much heavier without making it taller."""
    changes = []
    for component in range(1, 4):
        ends = [shaped(body, **{f"beta_{component}": value}) for value in (-2.0, 2.0)]
        volumes = [as_mesh(end, body.faces).volume for end in ends]
        girths = [waist_girth_m(body, end) for end in ends]
        assert abs(np.ptp(ends[0][:, 1]) - np.ptp(ends[1][:, 1])) < 0.04
        changes.append((max(volumes) / min(volumes), max(girths) - min(girths)))
    volume_ratio, girth_change_m = np.array(changes).max(axis=0)
    assert 1.2 < volume_ratio < 2.0
    assert 0.1 < girth_change_m < 0.5


def test_betas_have_falling_importance(body: BodyModelData) -> None:
    energy = (body.shapedirs**2).sum(axis=(0, 1))
    assert (np.diff(energy) < 0).all()
    assert energy[0] > 2 * energy[1]


def test_random_bodies_stay_closed_and_human(body: BodyModelData) -> None:
    betas = np.random.default_rng(0).normal(size=(20, 10)).clip(-2.5, 2.5)
    for vertices in shaped_vertices(body, betas):
        mesh = as_mesh(vertices, body.faces)
        bmi = mesh.volume * 985 / np.ptp(vertices[:, 1]) ** 2
        assert 14 < bmi < 45
        assert 1.4 < np.ptp(vertices[:, 1]) < 2.1


def test_pose_blend_shapes_act_when_posed_and_only_near_the_joint(female: BodyModelData) -> None:
    elbow = SMPL_JOINT_NAMES.index("left_elbow")
    columns = female.posedirs.reshape(6890, 3, 23, 9)[:, :, elbow - 1]
    touched = np.abs(columns).max(axis=(1, 2)) > 0
    distance_m = np.linalg.norm(female.v_template - female.joints[elbow], axis=1)
    assert 50 < touched.sum() < 1000
    assert distance_m[touched].max() < 0.3


@pytest.mark.parametrize(
    ("joint", "axis_angle"),
    [("left_knee", (2.0, 0, 0)), ("right_knee", (1.6, 0, 0)), ("left_hip", (-1.8, 0, 0))],
)
def test_pose_blend_shapes_keep_more_volume_than_linear_blending(
    body: BodyModelData, joint: str, axis_angle: tuple[float, float, float]
) -> None:
    pose = np.zeros((1, 24, 3))
    pose[0, SMPL_JOINT_NAMES.index(joint)] = axis_angle
    zero = np.zeros((1, 10)), np.zeros((1, 3))
    corrected = pose_vertices(body, zero[0], pose, zero[1])[0]
    rigid = BodyModelData(**{**vars(body), "posedirs": np.zeros_like(body.posedirs)})
    linear = pose_vertices(rigid, zero[0], pose, zero[1])[0]
    assert 5e-3 < np.linalg.norm(corrected - linear, axis=1).max() < 0.12
    rest_volume = as_mesh(body.v_template, body.faces).volume
    lost = [rest_volume - as_mesh(v, body.faces).volume for v in (corrected, linear)]
    assert 0 < lost[0] < lost[1]


def test_unknown_embedded_body_is_named() -> None:
    with pytest.raises(DsnetError, match=r"embedded:child.*embedded:female or embedded:male"):
        load_body_model("embedded:child")
