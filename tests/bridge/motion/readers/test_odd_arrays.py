"""Arrays of SMPL's family and places of joints in layouts that only look like the usual ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.readers import read_motion_file
from tests.forged.walks import FRAMES, joints_m, walk

POSE, PLACES_M = walk()
MATRICES = Rotation.from_rotvec(POSE.reshape(-1, 3)).as_matrix().reshape(FRAMES, 22, 3, 3)
LINES, COLUMNS = MATRICES[..., :2, :].reshape(FRAMES, 22, 6), MATRICES[..., :, :2]
COLUMNS = COLUMNS.swapaxes(2, 3).reshape(FRAMES, 22, 6)


def read(tmp_path: Path, **arrays: Any) -> Motion:
    np.savez(
        tmp_path / "a.npz", **{"trans": PLACES_M, "fps": 60.0, "betas": np.zeros(10), **arrays}
    )
    return read_motion_file(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("root", "body"),
    [
        (MATRICES[:, 0], MATRICES[:, 1:]),
        (MATRICES[:, :1], MATRICES[:, 1:]),
        (LINES[:, :1], LINES[:, 1:]),
        (COLUMNS[:, :1], COLUMNS[:, 1:]),
        (POSE[:, 0], LINES[:, 1:]),
        (POSE[:, :1], POSE[:, 1:]),
    ],
    ids=["matrix", "matrices", "lines", "columns", "lines of the body", "turns"],
)
def test_root_and_body_are_read_in_any_layout(tmp_path, root, body):
    found = read(tmp_path, global_orient=root, body_pose=body)
    np.testing.assert_allclose(found.pose, POSE, atol=1e-6)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"global_orient": POSE[:, 0], "body_pose": POSE}, "'body_pose' has 22 joints"),
        ({"global_orient": LINES[:, :1], "body_pose": POSE[:, 1:]}, "lines or columns"),
        ({"global_orient": POSE[:, 0], "body_pose": POSE[:1, 1:]}, "different numbers of frames"),
        ({"global_orient": MATRICES[:1, 0], "body_pose": MATRICES[0]}, "'body_pose' have shape"),
        ({"poses": np.zeros((FRAMES, 1, 72))}, "whether of frames or of people"),
    ],
)
def test_what_can_be_read_in_two_ways_is_refused(tmp_path, arrays, said):
    with pytest.raises(DsnetError, match=said):
        read(tmp_path, **arrays)


def test_of_two_rates_a_user_says_which(tmp_path):
    read(tmp_path, poses=POSE, mocap_framerate=120.0, fps=30.0)
    with pytest.raises(DsnetError, match="or says two"):
        load_motion(tmp_path / "a.npz")
    assert load_motion(tmp_path / "a.npz", 30.0).source_fps == 30


def test_a_length_that_the_rate_does_not_give_is_told(tmp_path):
    notes = read(tmp_path, poses=POSE, mocap_time_length=FRAMES / 60 * 2).notes
    assert any("says that it lasts" in note and "--motion-fps" in note for note in notes)
    notes = read(tmp_path, poses=POSE, mocap_time_length=FRAMES / 60).notes
    assert not any("lasts" in note for note in notes)
    notes = read(tmp_path, poses=POSE, mocap_time_length="unknown").notes
    assert not any("lasts" in note for note in notes)


def test_betas_may_stand_in_a_column(tmp_path):
    betas = np.linspace(-1, 1, 10)
    np.testing.assert_array_equal(read(tmp_path, poses=POSE, betas=betas[:, None]).betas, betas)


def test_hands_and_kinds_of_other_names_are_known(tmp_path):
    hand = np.full((FRAMES, 15, 3), 0.1)
    apart = {"root_orient": POSE[:, 0], "pose_body": POSE[:, 1:].reshape(FRAMES, 63)}
    found = read(tmp_path, **apart, pose_lhand=hand, pose_rhand=2 * hand)
    assert found.hands_and_face is not None
    np.testing.assert_array_equal(
        found.hands_and_face[:, -30:], np.concatenate([hand, 2 * hand], 1)
    )
    found = read(tmp_path, **apart, jaw_pose=np.zeros((FRAMES, 3)), right_hand_pose=hand)
    assert found.kind == "smplx"
    assert any("'right_hand_pose' is relative to" in note for note in found.notes)


def places(tmp_path: Path, stored: Any) -> Motion:
    np.save(tmp_path / "a.npy", stored, allow_pickle=True)
    return read_motion_file(tmp_path / "a.npy")


@pytest.mark.parametrize("axes", [[0, 2, 1], [1, 0, 2]])
def test_places_in_a_mirror_are_turned_round_and_told(tmp_path, axes):
    """As of who exchanges two axes: hips and feet point the way of the motion again."""
    found = places(tmp_path, joints_m()[..., axes])
    assert any("point backwards" in note for note in found.notes)
    way = found.trans_m[-1] - found.trans_m[0]
    forward = Rotation.from_rotvec(found.pose[:, 0]).apply([0.0, 0.0, 1.0]).mean(axis=0)
    assert forward @ way > 0.9 * np.linalg.norm(way)
    assert not any("backwards" in note for note in places(tmp_path, joints_m()).notes)


def test_joints_in_another_order_are_refused(tmp_path):
    with pytest.raises(DsnetError, match="cm from a body's in the mean"):
        places(tmp_path, joints_m()[:, ::-1])


def test_a_sample_ends_where_its_length_says(tmp_path):
    filled = np.concatenate([joints_m(), np.zeros((9, 22, 3))]).transpose(1, 2, 0)
    stored = {"motion": np.stack([filled, filled]), "lengths": np.array([FRAMES, FRAMES + 9])}
    found = places(tmp_path, stored)
    assert len(found.theta) == FRAMES
    assert any("2 samples: the first is read" in note for note in found.notes)
    assert any("says no rate" in note for note in found.notes)
