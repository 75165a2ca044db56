"""Worlds that are a camera's: upright by their floor or their bodies, or refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from tests.forged.motion_kinds import apart
from tests.forged.walks import FRAMES, about, matrices, of_camera, smpl, walk, y_up


def read(tmp_path: Path, **arrays: Any) -> Motion:
    np.savez(tmp_path / "a.npz", **arrays)
    return load_motion(tmp_path / "a.npz", 60.0)


def turned(turn: np.ndarray, **arrays: Any) -> dict[str, Any]:
    """The walk in another world."""
    poses = y_up()
    poses[:, :3] = Rotation.from_matrix(turn @ matrices(walk()[0][:, 0])).as_rotvec()
    return {"poses": poses, "trans": walk()[1] @ turn.T, **arrays}


@pytest.fixture
def upright(tmp_path: Path) -> Motion:
    return read(tmp_path, **smpl())


@pytest.mark.parametrize("pitch_deg", [0, 40, -30, 75])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_floor_says_where_up_is(
    tmp_path: Path, upright: Motion, pitch_deg: float, sign: float
) -> None:
    stored = of_camera(pitch_deg)
    motion = read(tmp_path, **stored | {"floor_plane": sign * stored["floor_plane"]})
    turn_deg, place_m = apart(motion, upright)
    assert turn_deg < 1e-3
    assert place_m < 1e-6
    assert any(f"pitched by {abs(pitch_deg)} degrees" in note for note in motion.notes)


def test_a_root_turns_about_its_joint_in_any_world(tmp_path: Path) -> None:
    """As if the joint rested at the origin, plus what turning the world adds."""
    joint, turn = np.array([0.1, -0.2, 0.05]), about("x", 140)
    stored = turned(turn, floor_plane=turn[:, 1])
    stored["trans"] = (walk()[1] + joint) @ turn.T - joint
    motion = read(tmp_path, **stored).about_root_joint(joint)
    np.testing.assert_allclose(motion.trans_m, walk()[1], atol=1e-9)


@pytest.mark.parametrize("pitch_deg", [0, 40])
def test_without_a_floor_bodies_show_it(tmp_path: Path, upright: Motion, pitch_deg: float) -> None:
    motion = read(tmp_path, **of_camera(pitch_deg, floor=False))
    assert apart(motion, upright)[0] < 3
    assert any("as its bodies stand, to some degrees" in note for note in motion.notes)


def test_bodies_that_stand_no_way_are_refused(tmp_path: Path) -> None:
    stored = of_camera(0, floor=False)
    spin = Rotation.from_euler("x", np.linspace(0, 360, FRAMES)[:, None], degrees=True).as_rotvec()
    with pytest.raises(DsnetError, match=r"do not show where up is.*floor_plane"):
        read(tmp_path, **stored | {"root_orient": np.stack([spin, spin])})


@pytest.mark.parametrize("degrees", [180, 140, -150])
def test_a_world_without_a_camera_is_not_turned_over(tmp_path: Path, degrees: float) -> None:
    with pytest.raises(DsnetError, match=r"head down.*space of a camera"):
        read(tmp_path, **turned(about("x", degrees)))


@pytest.mark.parametrize("degrees", [35, 55])
def test_bodies_that_lean_all_the_time_are_told(tmp_path: Path, degrees: float) -> None:
    motion = read(tmp_path, **turned(about("x", degrees)))
    assert any("degrees all the time" in note for note in motion.notes)


def test_a_copy_of_the_roots_turn_is_no_second_one(tmp_path: Path) -> None:
    poses = smpl()["poses"]
    for copy in (poses[:, :3], matrices(poses[:, :3])):
        assert len(read(tmp_path, **smpl(Rh=copy)).theta) == FRAMES
    for other in ({"Rh": 0.5 * poses[:, :3]}, {"Rh": poses[:, :3], "Th": walk()[1]}):
        with pytest.raises(DsnetError, match="EasyMocap"):
            read(tmp_path, **smpl(**other))


@pytest.mark.parametrize("rate", [0.0, np.nan, -30.0, np.inf, "none", np.zeros(3)])
def test_a_rate_that_is_none_gives_way_to_the_users(tmp_path: Path, rate: Any) -> None:
    motion = read(tmp_path, **smpl(mocap_framerate=rate))
    assert motion.source_fps == 60
    assert any("is read at 60 frames a second" in note for note in motion.notes)
    with pytest.raises(DsnetError, match=r"mocap_framerate.*--motion-fps"):
        load_motion(tmp_path / "a.npz")
