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
from bridge.motion.motion import MOST_FRAMES
from bridge.motion.readers import amass
from bridge.motion.readers.amass import CYCLE, SAMPLES, sample_path
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
    motion = load_amass_motion(save(target, layout(5, 30.0), betas=np.arange(16.0)[None]))
    np.testing.assert_array_equal(motion.betas, np.arange(10.0))
    assert (motion.source_fps, motion.fps, len(motion.theta)) == (30.0, 60.0, 9)


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
    assert amass.gender_of(save(target, shape())) is None


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
        ({"mocap_framerate": "fast"}, "mocap_framerate is fast"),
        ({"mocap_framerate": 0.0}, "mocap_framerate is 0.0"),
        ({"mocap_framerate": -120.0}, "mocap_framerate is -120.0"),
        ({"mocap_framerate": 1e-6}, "mocap_framerate is 1e-06"),
        ({"mocap_framerate": [60.0, 60.0]}, r"mocap_framerate is \[60.0, 60.0\]"),
        ({"mocap_framerate": np.nan}, "mocap_framerate is nan"),
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
def test_each_sample_is_one_movement_of_four_seconds_or_one_lap(name):
    motion, frames = load_amass_motion(f"sample:{name}"), 61 if name == CYCLE else 240
    assert (motion.gender, motion.fps, len(motion.theta)) == ("female", 60.0, frames)
    assert motion.pieces == [slice(0, frames)]
    assert np.ptp(motion.theta, axis=0).max() > 0.3
    with np.load(sample_path(name)) as arrays:
        assert arrays["source"] == "synthetic"
    if name == CYCLE:
        lap = close_loop(motion.theta, np.zeros(3))
        assert lap.dropped
        np.testing.assert_allclose(lap.repeated(3), np.tile(lap.theta, (3, 1)), atol=1e-6)
        return
    with pytest.raises(DsnetError, match=r"--loop with a motion.* as sample:walk_cycle is"):
        close_loop(motion.theta, np.zeros(3))


def test_an_unknown_one_is_refused_with_those_that_there_are():
    with pytest.raises(DsnetError, match=r"sample:flying; expected .*sample:walking"):
        load_amass_motion("sample:flying")


CODECS = {"bodyPose": np.zeros((5, 22, 3)), "bodyTranslation": np.zeros((5, 3)), "frameRate": 60.0}


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
