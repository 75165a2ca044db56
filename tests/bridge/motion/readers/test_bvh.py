"""BVH: SMPL's own skeleton comes back as it was, others keep the directions of their limbs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_JOINT_NAMES, SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError
from bridge.motion import load_motion, unpack_theta
from bridge.motion.skeletons import plain_names
from tests.forged.bvh import Skeleton, text, world_of
from tests.forged.lively import lively
from tests.forged.walks import MIXAMO, about, named

FRAMES = 12
REST_M = shaped_joints(load_body_model("embedded:female"), np.zeros((1, 10)))[0]
SMPL = Skeleton(SMPL_JOINT_NAMES, SMPL_PARENTS, REST_M)
BIPED = named(
    "Bip01_Pelvis,Bip01_Spine,Bip01_Spine1,Bip01_Spine2,Bip01_Neck,Bip01_Head",
    "Thigh,Calf,Foot,Toe,Clavicle,UpperArm,Forearm,Hand",
    "Bip01_{S}_{name}",
)
DAZ = named(
    "hip,abdomen,Spine1,chest,neck,head",
    "Thigh,Shin,Foot,Toe,Collar,Shldr,ForeArm,Hand",
    "{s}{name}",
)
CMU = [{"Spine": "LowerBack", "Spine1": "Spine", "Spine2": "Spine1"}.get(n, n) for n in MIXAMO]
LIMBS = [(1, 4), (2, 5), (4, 7), (5, 8), (16, 18), (17, 19), (18, 20), (19, 21)]


def pose_and_places(seed: int = 0):
    pose, trans_m = unpack_theta(lively(FRAMES, seed))
    return pose, trans_m + np.array([0.0, 1.0, 0.0])


def write(path, skeleton, world, root, **options):
    path.write_text(text(skeleton, world, root, **options))
    return path


def a_pose(down_deg: float = 45.0) -> np.ndarray:
    """The rest pose with arms so far down."""
    rest = REST_M.copy()
    for side, (shoulder, arm) in {1: (16, (18, 20, 22)), -1: (17, (19, 21, 23))}.items():
        down = Rotation.from_euler("z", -down_deg * side, degrees=True)
        rest[list(arm)] = rest[shoulder] + down.apply(rest[list(arm)] - rest[shoulder])
    return rest


@pytest.mark.parametrize("unit", [1.0, 100.0, 39.37])
def test_smpls_own_skeleton_comes_back_in_metres(tmp_path, unit):
    pose, places_m = pose_and_places()
    skeleton = Skeleton(SMPL.names, SMPL.parents, unit * REST_M)
    motion = load_motion(write(tmp_path / "walk.bvh", skeleton, world_of(pose), unit * places_m))
    found, trans_m = unpack_theta(motion.theta)
    np.testing.assert_allclose(world_of(found), world_of(pose), atol=1e-6)
    np.testing.assert_allclose(trans_m, places_m, atol=1e-6)
    assert (motion.fps, motion.gender, np.abs(motion.betas).max()) == (60.0, "unknown", 0.0)


def test_other_names_lengths_axes_and_rest_poses_keep_the_limbs_directions(tmp_path):
    """Mixamo's names, z up, centimetres, longer legs and arms that rest in an A."""
    z_up = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    rest = a_pose()
    rest[[4, 7, 10]] += [0.0, -0.1, 0.0]
    rest[[5, 8, 11]] += [0.0, -0.1, 0.0]
    pose, places_m = pose_and_places()
    world = z_up @ world_of(pose) @ z_up.T
    names = [f"mixamorig:{name}" for name in MIXAMO]
    skeleton = Skeleton(names, SMPL_PARENTS, 100 * rest @ z_up.T)
    path = write(tmp_path / "dance.bvh", skeleton, world, 100 * places_m @ z_up.T)
    found, trans_m = unpack_theta(load_motion(path).theta)
    turned = world_of(found)
    for joint, end in LIMBS:
        bone = REST_M[end] - REST_M[joint]
        theirs = world_of(pose)[:, joint] @ (rest[end] - rest[joint])
        assert _angle_deg(turned[:, joint] @ bone, theirs).max() < 1e-3, (joint, end)
    for joint in (0, 3, 6, 9, 12, 15, 7, 8, 13, 14):  # trunk, head, collars and feet turn alike
        np.testing.assert_allclose(turned[:, joint], world_of(pose)[:, joint], atol=1e-6)
    # The middle of the hips goes as theirs, by the length of the legs.
    leg, theirs = (_leg(joints) for joints in (REST_M, rest))
    below, their_below = (joints[[1, 2]].mean(axis=0) - joints[0] for joints in (REST_M, rest))
    hips = trans_m + world_of(pose)[:, 0] @ below
    their_hips = places_m + world_of(pose)[:, 0] @ their_below
    np.testing.assert_allclose(hips, their_hips * leg / theirs, atol=1e-6)


@pytest.mark.parametrize("down_deg", [45.0, 85.0])
def test_arms_that_hang_at_rest_hang_in_smpl(tmp_path, down_deg):
    """What is no rotation in such a file is one of 45 degrees for a body that rests in a T."""
    still = np.broadcast_to(np.eye(3), (FRAMES, 24, 3, 3))
    skeleton = Skeleton(MIXAMO, SMPL_PARENTS, a_pose(down_deg))
    path = write(tmp_path / "stand.bvh", skeleton, still, np.zeros((FRAMES, 3)))
    turned = world_of(unpack_theta(load_motion(path).theta)[0])
    for joint, _ in LIMBS:
        down = (down_deg if joint % 2 else -down_deg) * (joint >= 16)
        np.testing.assert_allclose(turned[0, joint], about("z", down), atol=1e-6)
    np.testing.assert_allclose(turned[:, 20:22], turned[:, 18:20], atol=1e-6)  # hands
    trunk = [0, 3, 6, 9, 12, 13, 14, 15, 7, 8, 10, 11]
    np.testing.assert_allclose(turned[:, trunk], still[:, trunk], atol=1e-6)


@pytest.mark.parametrize("names", [CMU, BIPED, DAZ], ids=["cmu", "biped", "daz"])
def test_whole_skeletons_of_other_names_are_found(tmp_path, names):
    pose, places_m = pose_and_places()
    skeletons = (Skeleton(MIXAMO, SMPL_PARENTS, REST_M), Skeleton(names, SMPL_PARENTS, REST_M))
    first, second = (
        load_motion(write(tmp_path / f"{n}.bvh", one, world_of(pose), places_m)).theta
        for n, one in enumerate(skeletons)
    )
    np.testing.assert_array_equal(first, second)


def test_positions_below_the_root_are_places_as_blender_writes_them(tmp_path):
    """Six channels on every joint, under a root that stands still: the pelvis goes by its own."""
    pose, places_m = pose_and_places()
    plain = load_motion(write(tmp_path / "walk.bvh", SMPL, world_of(pose), places_m))
    skeleton = Skeleton(
        ["Armature", *SMPL.names], [-1, *(1 + parent for parent in SMPL_PARENTS)],
        np.concatenate([np.zeros((1, 3)), REST_M]),
    )  # fmt: skip
    world = np.concatenate([np.tile(np.eye(3), (FRAMES, 1, 1, 1)), world_of(pose)], axis=1)
    before = np.array([skeleton.rest[max(parent, 0)] for parent in skeleton.parents])
    local = np.tile(skeleton.rest - before, (FRAMES, 1, 1))
    local[:, 1] = places_m
    still = np.zeros((FRAMES, 3))
    path = write(tmp_path / "six.bvh", skeleton, world, still, places=local)
    np.testing.assert_allclose(load_motion(path).theta, plain.theta, atol=1e-6)
    # Positions count in place of offsets: longer thighs would move feet, which nobody asks for.
    local[:, 5] *= 1.5
    path = write(tmp_path / "long.bvh", skeleton, world, still, places=local)
    np.testing.assert_allclose(load_motion(path).theta, plain.theta, atol=1e-6)
    local[3, 5, 0] = np.nan
    assert "not all finite" in refused(tmp_path, text(skeleton, world, still, places=local))


def test_a_skeleton_without_collars_and_spine_is_enough(tmp_path):
    kept = [0, 1, 2, 4, 5, 7, 8, 12, 15, 16, 17, 18, 19, 20, 21]
    parents = [-1 if joint == 0 else kept.index(_kept_parent(joint, kept)) for joint in kept]
    skeleton = Skeleton([MIXAMO[joint] for joint in kept], parents, REST_M[kept])
    pose, places_m = pose_and_places()
    path = write(tmp_path / "bare.bvh", skeleton, world_of(pose)[:, kept], places_m)
    found = unpack_theta(load_motion(path).theta)[0]
    np.testing.assert_allclose(world_of(found)[:, 18], world_of(pose)[:, 18], atol=1e-6)
    np.testing.assert_allclose(found[:, [3, 6, 9, 13, 14]], 0, atol=1e-9)


def test_the_files_rate_is_resampled(tmp_path):
    pose, places_m = pose_and_places()
    path = write(tmp_path / "fast.bvh", SMPL, world_of(pose), places_m, fps=120.0)
    motion = load_motion(path)
    assert (len(motion.theta), motion.source_fps) == (6, 120.0)


@pytest.mark.parametrize(
    ("name", "other", "plain"),
    [("mixamorig:LeftUpLeg", "mixamorig:Hips", "lupleg"), ("m_avg_L_Hip", "m_avg_Pelvis", "lhip"),
     ("upper_arm.R", "hand.L", "rupperarm"), ("Bip01 R Thigh", "Bip01 Spine", "rthigh"),
     ("right_ankle", "left_knee", "rankle"), ("LowerBack", "LHipJoint", "lowerback"),
     ("J_Bip_C_Hips", "J_Bip_L_Hand", "hips"), ("ShoulderLeft", "SpineMid", "lshoulder"),
     ("l_upleg_JNT", "spine_JNT", "lupleg"), ("left_toes_joint", "hips_joint", "ltoes"),
     ("hip_jnt_L", "root", "lhip"), ("lf_knee_bind", "spine_bind", "lknee"),
     ("LeftHandJoint", "SpineJoint", "lhand"), ("LHipJoint", "LeftUpLeg", "lhipjoint"),
     ("thigh_L_jnt_01", "spine_jnt_01", "lthigh"), ("jnt_l_thigh", "spine", "lthigh"),
     ("thigh_l_v2", "spine_v2", "lthigh")],
)  # fmt: skip
def test_names_of_many_programs_are_one(name, other, plain):
    assert plain_names((name, other))[0] == plain


def refused(tmp_path, content: str, name: str = "odd.bvh") -> str:
    (tmp_path / name).write_text(content)
    with pytest.raises(DsnetError) as error:
        load_motion(tmp_path / name)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_what_cannot_be_followed_is_one_line(tmp_path):
    pose, places_m = pose_and_places()
    whole = text(SMPL, world_of(pose), places_m)
    spread = Skeleton(MIXAMO, SMPL_PARENTS, np.abs(REST_M).sum(1, keepdims=True) * [[1.0, 0, 0]])
    assert "in one line at rest" in refused(tmp_path, text(spread, world_of(pose), places_m))
    tail = Skeleton([f"tail{n}" for n in range(24)], SMPL_PARENTS, REST_M)
    assert "has no pelvis, left_hip" in refused(tmp_path, text(tail, world_of(pose), places_m))
    assert "not all finite" in refused(tmp_path, whole.replace(whole.split()[-1], "nan"))
    assert "e+03 m off" in refused(tmp_path, text(SMPL, world_of(pose), 1.2e3 + places_m))
    assert "frames a second" in refused(tmp_path, whole.replace("Time: 0.0166", "Time: 16.6"))
    assert "of 75 channels" in refused(tmp_path, whole.rstrip().rpartition(" ")[0])
    six = whole.replace("CHANNELS 3 ", "CHANNELS 6 Xposition Yposition Zposition ")
    assert "75 numbers in a line of 144 channels" in refused(tmp_path, six)
    four = whole.replace("CHANNELS 3 Z", "CHANNELS 4 Zrotation Z")
    assert "joint left_hip with a channel twice" in refused(tmp_path, _wider(four))
    assert "does not load" in refused(tmp_path, "")
    with pytest.raises(DsnetError, match="does not exist"):
        load_motion(tmp_path / "none.bvh")


def test_numbers_of_many_programs_are_one(tmp_path):
    """Decimal commas, commas between numbers, and all frames in one line."""
    pose, places_m = pose_and_places()
    whole = text(SMPL, world_of(pose), places_m)
    theta = load_motion(write(tmp_path / "walk.bvh", SMPL, world_of(pose), places_m)).theta
    head, time, rows = whole.partition("Frame Time: 0.016666667\n")
    one_line = " ".join(rows.split())
    for odd in (whole.replace(".", ","), head + time + rows.replace(" ", ", "),
                head + time + one_line):  # fmt: skip
        (tmp_path / "odd.bvh").write_text(odd)
        np.testing.assert_array_equal(load_motion(tmp_path / "odd.bvh").theta, theta)
    other = head.replace("Frames: 12", "Frames: 13") + time + one_line
    assert "900 numbers in a line of 75 channels" in refused(tmp_path, other)


@pytest.mark.parametrize("down_deg", [30.0, 75.0])
def test_smpls_names_do_not_say_that_it_rests_as_smpl_does(tmp_path, down_deg):
    pose, places_m = pose_and_places()
    ours, theirs = (
        load_motion(
            write(
                tmp_path / "walk.bvh",
                Skeleton(names, SMPL_PARENTS, a_pose(down_deg)),
                world_of(pose),
                places_m,
            )
        ).theta
        for names in (SMPL_JOINT_NAMES, MIXAMO)
    )
    np.testing.assert_array_equal(ours, theirs)


def _wider(whole: str) -> str:
    """Each frame with a number for one more channel of every joint below the root."""
    head, _, rows = whole.partition("Frame Time")
    time, *rows = rows.splitlines()
    return "\n".join([f"{head}Frame Time{time}", *(row + 23 * " 0" for row in rows)])


def _kept_parent(joint: int, kept: list[int]) -> int:
    parent = SMPL_PARENTS[joint]
    return parent if parent in kept else _kept_parent(parent, kept)


def _angle_deg(one, other):
    cross = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.degrees(np.arctan2(cross, (one * other).sum(-1)))


def _leg(joints) -> float:
    return float(np.linalg.norm(joints[4] - joints[1]) + np.linalg.norm(joints[7] - joints[4]))
