"""AMASS files of every variety, forged, and every way in which one can be unusable."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.motion import load_motion
from bridge.motion.motion import MOST_FRAMES
from bridge.motion.readers import amass
from bridge.motion.readers.amass import CYCLE, SAMPLES, motion_path, sample_path
from bridge.motion.readers.smpl_fields import TRANS_KEYS
from dsnet.prediction.loops import close_loop
from tests.forged.amass import load_amass_motion, save, shape, smpl, smplh, smplx

Layout = Callable[..., dict[str, Any]]


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "motion_poses.npz"


@pytest.mark.parametrize(("layout", "width"), [(smpl, 72), (smplh, 156), (smplx, 165)])
def test_every_layout_begins_with_the_papers_22_joints(
    target: Path, layout: Layout, width: int
) -> None:
    rng = np.random.default_rng(0)
    poses, trans = rng.uniform(-1, 1, (3, width)), rng.normal(size=(3, 3))
    stored = amass.read(save(target, layout(3, 60.0), poses=poses, trans=trans))
    np.testing.assert_array_equal(stored.pose.reshape(3, 66), poses[:, :66])
    np.testing.assert_array_equal(stored.trans_m, trans)
    np.testing.assert_array_equal(stored.betas, layout()["betas"][:10])
    assert (stored.gender, stored.fps) == ("female", 60.0)


def test_stageii_joints_are_those_of_its_own_parts(target: Path) -> None:
    """The hands, jaw and eyes that follow the body in `poses` reach none of the 22."""
    rng = np.random.default_rng(1)
    parts = {key: rng.normal(size=smplx()[key].shape) for key in ("root_orient", "pose_body")}
    rest = rng.normal(size=(5, 99))
    arrays = smplx() | parts | {"poses": np.concatenate([*parts.values(), rest], axis=1)}
    stored = amass.read(save(target, arrays))
    np.testing.assert_array_equal(stored.pose[:, 0], parts["root_orient"])
    np.testing.assert_array_equal(stored.pose[:, 1:].reshape(5, 63), parts["pose_body"])


@pytest.mark.parametrize("name", TRANS_KEYS)
def test_translations_of_minutes_are_read_whatever_their_name(target: Path, name: str) -> None:
    arrays = smplh(3600, 60.0)
    arrays[name] = np.add(arrays.pop("trans"), [0, 0, 1])
    np.testing.assert_array_equal(amass.read(save(target, arrays)).trans_m, arrays[name])


def test_dmpls_are_kept_where_there_are_some(target: Path) -> None:
    dmpls = np.random.default_rng(2).normal(size=(5, 8))
    stored = amass.read(save(target, smplh(), dmpls=dmpls))
    np.testing.assert_array_equal(stored.dmpls, dmpls)
    assert amass.read(save(target, smplx())).dmpls is None


@pytest.mark.parametrize("layout", [smpl, smplh, smplx])
def test_rate_under_either_name(target: Path, layout: Layout) -> None:
    motion = load_amass_motion(save(target, layout(5, 30.0)))
    assert (motion.source_fps, motion.fps, len(motion.theta)) == (30.0, 60.0, 9)


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        (b"female", "female"),
        ("male", "male"),
        (np.array("Neutral"), "neutral"),
        (np.array([b"male"]), "male"),
        (None, "unknown"),
        ("", "unknown"),
        (np.array(["female", "male"]), "unknown"),
        (np.array("female", ">U8"), "female"),
        # A character that there is not, found by fuzzing: Python fails on it.
        (np.array([0x7FFFFFFF, 0x20], np.uint32).view("=U2"), "unknown"),
    ],
)
def test_gender(target: Path, stored: Any, expected: str) -> None:
    save(target, smplh(), gender=stored)
    assert amass.read(target).gender == amass.gender_of(target) == expected


def test_a_shape_file_is_no_motion(target: Path) -> None:
    assert amass.gender_of(save(target, shape())) is None


@pytest.mark.parametrize("betas", [np.arange(16.0), np.arange(10.0), np.arange(16.0)[None]])
def test_first_ten_betas(target: Path, betas: np.ndarray) -> None:
    stored = amass.read(save(target, smplh(), betas=betas))
    np.testing.assert_array_equal(stored.betas, np.arange(10.0))


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"poses": None}, "has no 'poses'"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "zero frames"),
        ({"poses": np.full((5, 156), np.nan)}, "not all finite"),
        ({"trans": np.full((5, 3), np.inf)}, "not all finite"),
        ({"poses": np.zeros((5, 150))}, r"shape \(5, 150\).*72 \(SMPL\), 156 \(SMPL-H\), 159"),
        ({"poses": np.zeros((5, 63))}, r"shape \(5, 63\)"),
        ({"poses": np.zeros(156)}, r"shape \(156,\)"),
        ({"Rh": np.zeros((5, 3))}, "'Rh', as EasyMocap's"),
        ({"poses": np.array(0.0)}, r"shape \(\)"),
        ({"poses": np.zeros((0, 5, 156))}, r"shape \(0, 5, 156\)"),
        ({"poses": np.zeros((5, 156), complex)}, "not all finite numbers"),
        ({"trans": np.zeros((4, 3))}, "beside 5 frames"),
        ({"trans": np.zeros((5, 2))}, r"shape \(5, 2\)"),
        ({"dmpls": np.zeros((4, 8))}, "beside 5 frames"),
        ({"betas": np.zeros((1, 5, 10))}, r"shape \(1, 5, 10\)"),
        ({"betas": np.array(0.0)}, r"shape \(\)"),
        ({"poses": None, "pose_body": np.zeros((5, 63))}, "'pose_body' and no 'root_orient'"),
        ({"poses": np.ones((5, 24, 3, 3))}, "no rotations"),
        ({"poses": np.tile([1.0, 0, 0, 0, 1, 0], (5, 22))}, "lines or columns"),
        ({"mocap_framerate": "fast"}, "not all finite"),
        ({"mocap_framerate": 0.0}, "mocap_framerate is 0.0"),
        ({"mocap_framerate": -120.0}, "mocap_framerate is -120.0"),
        ({"mocap_framerate": 1e-6}, "mocap_framerate is 1e-06"),
        ({"mocap_framerate": [60.0, 60.0]}, r"mocap_framerate is \[60.0, 60.0\]"),
        ({"mocap_framerate": np.nan}, "not all finite"),
        ({"poses": np.array([["a"]])}, "not all finite numbers"),
        ({"betas": np.array([{}], dtype=object)}, "does not load"),
        ({"gender": np.array({}, dtype=object)}, "'gender' is an object of another kind"),
        ({"trans": np.array({}, dtype=object)}, "'trans' is an object of another kind"),
        ({"mocap_framerate": np.array({}, dtype=object)}, "is an object of another kind"),
    ],
)
def test_unusable_contents_are_refused_in_one_line(
    target: Path, changes: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(DsnetError, match=complaint) as caught:
        amass.read(save(target, smplh(), **changes))
    assert "\n" not in str(caught.value)
    assert str(target) in str(caught.value)


@pytest.mark.parametrize("read", [amass.read, amass.gender_of])
def test_unusable_files_are_refused_in_one_line(
    tmp_path: Path, read: Callable[[Path], object]
) -> None:
    whole = save(tmp_path / "whole.npz", smplh()).read_bytes()
    (tmp_path / "text.npz").write_text("not a zip\n")
    (tmp_path / "empty.npz").touch()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    np.save(tmp_path / "plain.npy", np.zeros((5, 156)))
    for name in ("absent.npz", ".", "text.npz", "empty.npz", "half.npz", "plain.npy"):
        with pytest.raises(DsnetError, match="expected") as caught:
            read(tmp_path / name)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"poses": np.full((5, 156), 1e160)}, "turn a joint by 1e.160 rad.*Angles are radians"),
        ({"trans": np.full((5, 3), 1e39)}, "'trans' are 1e.39 m off.*convert it"),
        ({"trans": np.full((5, 3), 900.0)}, "it seems to be in millimetres"),
        ({"trans": np.full((5, 3), 90.0)}, "it seems to be in centimetres"),
        ({"betas": np.full(16, 1e10)}, "'betas' reach 1e.10"),
        ({"dmpls": np.zeros((5, 0))}, "'dmpls' have shape"),
        ({"poses": np.zeros((5, 0))}, "'poses' have shape"),
        ({"poses": np.zeros((3_000_000, 156), "i1")}, "'poses' is of|3000000 frames"),
        ({"gender": "female" * 10_000}, "'gender' is of 240000 bytes"),
    ],
)
def test_what_nobody_does_is_refused_by_name(
    tmp_path: Path, changes: dict[str, Any], complaint: str
) -> None:
    path = tmp_path / "motion.npz"
    np.savez_compressed(path, **(smplh() | changes))
    with pytest.raises(DsnetError, match=complaint) as caught:
        load_amass_motion(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("rate", "fps"), [(1.0, 60.0), (120.0, 1e9)])
def test_more_frames_than_a_file_may_make_are_not_made(
    tmp_path: Path, rate: float, fps: float
) -> None:
    path = save(tmp_path / "motion.npz", smplh(3000, rate), marker_data=None)
    with pytest.raises(DsnetError, match=f"expected at most {MOST_FRAMES}"):
        load_amass_motion(path, fps=fps)


@pytest.mark.parametrize("key", ["poses", "trans", "betas", "gender", "dmpls", "mocap_framerate"])
@pytest.mark.parametrize("content", [b"hello", b""])
def test_a_member_that_is_no_array_is_refused(tmp_path: Path, key: str, content: bytes) -> None:
    path = save(tmp_path / "motion.npz", smplh(), **{key: None})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"{key}.npy", content)
    with pytest.raises(DsnetError, match="does not load"):
        load_amass_motion(path)


def test_a_directory_of_many_members_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "motion.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(8000):
            archive.writestr(f"{number:0150}", b"")
    with pytest.raises(DsnetError, match="bytes at once"):
        load_amass_motion(path)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    for path in (tmp_path / "pipe.npz", Path("/dev/zero"), tmp_path / ("x" * 5000)):
        with pytest.raises(DsnetError, match="does not load"):
            load_amass_motion(path)


@pytest.mark.parametrize("name", SAMPLES)
def test_each_is_one_movement_of_four_seconds_or_one_lap(name):
    motion, frames = load_amass_motion(f"sample:{name}"), 61 if name == CYCLE else 240
    assert (motion.gender, motion.fps, len(motion.theta)) == ("female", 60.0, frames)
    assert motion.pieces == [slice(0, frames)]
    assert np.ptp(motion.theta, axis=0).max() > 0.3
    assert sample_path(name).stat().st_size < 50_000


def test_one_repeats_in_place():
    lap = close_loop(load_amass_motion(f"sample:{CYCLE}").theta, np.zeros(3))
    assert lap.dropped
    np.testing.assert_allclose(lap.repeated(3), np.tile(lap.theta, (3, 1)), atol=1e-6)


@pytest.mark.parametrize("name", sorted({*SAMPLES} - {CYCLE}))
def test_the_others_do_not_and_say_which_does(name):
    with pytest.raises(DsnetError, match=r"--loop with a motion.* as sample:walk_cycle is"):
        close_loop(load_amass_motion(f"sample:{name}").theta, np.zeros(3))


@pytest.mark.parametrize("name", SAMPLES)
def test_each_says_that_it_is_synthetic(name):
    with np.load(sample_path(name)) as arrays:
        assert arrays["source"] == "synthetic"


def test_an_unknown_one_is_refused_with_those_that_there_are():
    with pytest.raises(DsnetError, match=r"sample:flying; expected .*sample:walking"):
        load_amass_motion("sample:flying")


def test_other_paths_stay_what_they_are():
    assert motion_path("a/b.npz") == Path("a/b.npz")


@pytest.mark.parametrize(("layout", "kind", "count"), [(smplh, "smplh", 30), (smplx, "smplx", 33)])
def test_hands_and_face_are_kept(target: Path, layout: Layout, kind: str, count: int) -> None:
    rng = np.random.default_rng(3)
    poses = rng.uniform(-1, 1, (5, 66 + 3 * count))
    stored = amass.read(save(target, layout(5, 60.0), poses=poses))
    assert stored.kind == kind
    assert stored.hands_and_face is not None
    np.testing.assert_array_equal(stored.hands_and_face.reshape(5, -1), poses[:, 66:])
    np.testing.assert_array_equal(stored.more_betas, layout()["betas"][10:])
    still = amass.read(save(target, layout(5, 60.0)))
    assert (still.kind, still.hands_and_face) == (kind, None)


def test_hands_and_face_in_parts_are_smplxs_in_its_order(target: Path) -> None:
    rng = np.random.default_rng(4)
    parts = {
        key: rng.uniform(-1, 1, (5, width))
        for key, width in (("pose_jaw", 3), ("pose_eye", 6), ("pose_hand", 90))
    }
    whole = amass.read(save(target, smplx() | parts, poses=None))
    assert whole.hands_and_face is not None
    found = whole.hands_and_face.reshape(5, 99)
    np.testing.assert_array_equal(found, np.concatenate([*parts.values()], axis=1))
    no_face = {"poses": None, "pose_jaw": None, "pose_eye": None, "surface_model_type": None}
    hands = amass.read(save(target, smplx() | parts, **no_face))
    assert hands.kind == "smplh"
    assert hands.hands_and_face is not None
    np.testing.assert_array_equal(hands.hands_and_face.reshape(5, 90), parts["pose_hand"])


CODECS = {"bodyPose": np.zeros((5, 22, 3)), "bodyTranslation": np.zeros((5, 3)), "frameRate": 60.0}
SPLIT = {"root_orient": np.zeros((5, 3)), "body_pose": np.zeros((5, 63)), "fps": 60.0}


@pytest.mark.parametrize(
    ("arrays", "kind"),
    [
        (CODECS, None),
        *((CODECS | {"smplVersion": n}, kind) for n, kind in enumerate(("smpl", "smplh", "smplx"))),
        # What the file says goes before what its shapes are like.
        (CODECS | {"smplVersion": 2, "leftHandPose": np.ones((5, 15, 3))}, "smplx"),
        (SPLIT, None),
        (SPLIT | {"surface_model_type": "smplx"}, "smplx"),
        (SPLIT | {"surface_model_type": np.array(b"SMPLH")}, "smplh"),
        (smplh() | {"surface_model_type": "smpl"}, "smpl"),
        (SPLIT | {"body_pose": np.zeros((5, 69))}, "smpl"),
        (SPLIT | {"body_pose": np.zeros((5, 23, 3))}, "smpl"),
    ],
)
def test_whose_body_it_is_says_the_file_or_its_shapes(
    target: Path, arrays: dict[str, Any], kind: str | None
) -> None:
    motion = amass.read(save(target, arrays))
    assert motion.kind == kind
    assert not any("unknown kind" in note for note in motion.notes)


@pytest.mark.parametrize(
    "said", [{"smplVersion": 3}, {"smplVersion": [2, 2]}, {"surface_model_type": "skel"}]
)
def test_a_body_that_is_not_known_is_told(target: Path, said: dict[str, Any]) -> None:
    motion = amass.read(save(target, CODECS | said))
    assert motion.kind is None
    assert any(f"unknown kind of body ({next(iter(said))} " in note for note in motion.notes)


@pytest.mark.parametrize(
    ("arrays", "given", "columns", "count"),
    [
        (SPLIT, {"pose_jaw": 3, "pose_hand": 90}, [slice(3), slice(9, 99)], 33),  # no eyes
        (SPLIT, {"pose_eye": 6}, [slice(3, 9)], 33),
        (CODECS, {"leftHandPose": 45}, [slice(45)], 30),
        (CODECS, {"rightHandPose": 45}, [slice(45, 90)], 30),
        (CODECS, {"headPose": 9, "rightHandPose": 45}, [slice(9), slice(54, 99)], 33),
    ],
)
def test_parts_that_are_absent_are_at_rest_and_the_others_move(
    target: Path, arrays: dict[str, Any], given: dict[str, int], columns: list[slice], count: int
) -> None:
    rng = np.random.default_rng(5)
    parts = {key: rng.uniform(-1, 1, (5, width)) for key, width in given.items()}
    motion = amass.read(save(target, arrays | parts))
    expected = np.zeros((5, 3 * count))
    for where, part in zip(columns, parts.values(), strict=True):
        expected[:, where] = part
    assert motion.hands_and_face is not None
    np.testing.assert_array_equal(motion.hands_and_face.reshape(5, -1), expected)
    assert not any("left at rest" in note for note in motion.notes)


@pytest.mark.parametrize("wrong", [np.ones((4, 45)), np.ones((5, 12)), np.array("flat")])
def test_parts_of_another_shape_are_left_at_rest_and_told(target: Path, wrong: np.ndarray) -> None:
    left = np.full((5, 45), 0.2)
    motion = amass.read(save(target, CODECS, leftHandPose=left, rightHandPose=wrong))
    assert motion.hands_and_face is not None
    found = motion.hands_and_face.reshape(5, 90)
    np.testing.assert_array_equal(found, np.concatenate([left, np.zeros((5, 45))], axis=1))
    assert ["'rightHandPose' of shape" in note for note in motion.notes].count(True) == 1


def turned(root: Rotation, arrays: dict[str, Any], hips: float = 0.0) -> dict[str, Any]:
    """Somebody whose root is turned, and who with hips of -pi/2 sits with legs stretched."""
    pose = np.zeros((5, 22, 3))
    pose[:, 0], pose[:, 1:3, 0] = root.as_rotvec(), hips
    named = {"bodyPose": pose} if "bodyPose" in arrays else {"poses": pose.reshape(5, 66)}
    return arrays | named


def rolled(degrees: float) -> Rotation:
    """About x: by 90, what has y up has z up; with y up it lies on its face."""
    return Rotation.from_euler("x", degrees, degrees=True)


PLAIN = {"trans": np.zeros((5, 3)), "fps": 60.0}


@pytest.mark.parametrize(
    ("arrays", "up", "told"),
    [
        (turned(rolled(0), PLAIN, hips=-1.57), "y", True),  # sits, as z up people do below
        (turned(rolled(90), PLAIN, hips=-1.57), "z", False),
        (turned(rolled(0), PLAIN), "y", True),
        (turned(rolled(-90), PLAIN), "z", False),
        (turned(rolled(180), PLAIN, hips=-1.57), "z", False),  # bends down
        # Meshcapade's have y up: who lies with the head to -z or x, who bends, who is aslant.
        (turned(rolled(-90), CODECS), "y", False),
        (turned(Rotation.from_euler("z", 90, degrees=True), CODECS), "y", False),
        (turned(rolled(90), CODECS, hips=-1.57), "y", False),
        (turned(rolled(50), CODECS), "y", False),
        # Who stands along z may lie.
        (turned(rolled(90), CODECS), "z", True),
    ],
)
def test_which_way_is_up(target: Path, arrays: dict[str, Any], up: str, told: bool) -> None:
    motion = amass.read(save(target, arrays))
    assert motion.up == up
    said = f"is taken as {up} up, for its bodies stand so: --up says otherwise"
    assert any(said in note for note in motion.notes) == told


def test_who_stands_in_a_cameras_space_is_refused(target: Path) -> None:
    with pytest.raises(DsnetError, match="head down along y"):
        amass.read(save(target, turned(rolled(180), PLAIN)))


@pytest.mark.parametrize("value", [np.nan, 1e9])
def test_hands_that_no_body_has_stay_at_rest_and_are_told(target: Path, value: float) -> None:
    poses = smplh()["poses"]
    poses[3, 100] = value
    stored = amass.read(save(target, smplh(), poses=poses))
    assert stored.hands_and_face is None
    assert any("left at rest" in note for note in stored.notes)


def test_hands_are_resampled_and_smoothed_as_other_joints(target: Path) -> None:
    """What a wrist does, a finger does too."""
    turn = np.zeros((40, 156))
    turn[:, 0], turn[:, 60] = np.pi / 2, np.sin(np.arange(40) / 3)
    turn[:, 66] = turn[:, 60]
    file = save(target, smplh(40, 120.0), poses=turn)
    for smooth_hz in (None, 8.0):
        motion = load_motion(file, smooth_hz=smooth_hz)
        assert motion.hands_and_face is not None
        assert motion.hands_and_face.shape == (20, 30, 3)
        np.testing.assert_allclose(motion.hands_and_face[:, 0], motion.pose[:, 20], atol=1e-12)
        assert np.abs(motion.pose[:, 20]).max() > 0.5


def test_hands_relative_to_what_no_file_says_stay_flat_and_are_told(target: Path) -> None:
    arrays = {"global_orient": np.tile([np.pi / 2, 0, 0], (5, 1)), "body_pose": np.zeros((5, 63))}
    arrays |= {"transl": np.zeros((5, 3)), "left_hand_pose": np.ones((5, 12)), "fps": np.array(30)}
    motion = amass.read(save(target, arrays))
    assert motion.hands_and_face is None
    assert any("'left_hand_pose' is relative to" in note for note in motion.notes)
