"""Hands, faces and kinds of bodies in AMASS's files and those that look like them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.motion import load_motion
from bridge.motion.readers import amass
from tests.bridge.motion.readers.test_amass import CODECS, Layout
from tests.forged.amass import save, smplh, smplx


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "motion_poses.npz"


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
