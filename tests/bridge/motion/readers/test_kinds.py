"""Motion files of every kind that people have give the same walk, or say why not."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.motion import AS_IT_SAYS, HowRead, Up
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers.joints import motion_from_joints
from bridge.motion.skeletons import read_joint_map
from tests.forged.motion_kinds import (
    BEGIN,
    END,
    KINDS,
    MOST_DEG,
    MOST_M,
    PAGE,
    Kind,
    apart,
    outcome,
    table,
)
from tests.forged.walks import (
    FRAMES,
    HANGING,
    REST_CM,
    Turns,
    about,
    along_x,
    bvh,
    edited,
    joints_m,
    prop_first,
    smpl,
    trunk_cm,
    turned,
    walk,
    y_up,
)


def _whole(turn: np.ndarray, frames: Turns | None = None) -> Turns:
    """A rest pose turned as a whole."""
    return {joint: turn @ (frames or {}).get(joint, np.eye(3)) for joint in range(24)}


CASES = Path(os.environ.get("DSNET_TEST_CASES", "nowhere"))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.file)
def test_a_kind_is_read_as_the_reference_or_told_or_refused(kind: Kind, tmp_path: Path) -> None:
    came, right = outcome(kind, tmp_path)
    assert right, came


@pytest.mark.parametrize(
    "name",
    ["trunk.bvh", "smpl_a.bvh", "endings.bvh", "twists.bvh", "prop.bvh", "commas.bvh",
     "wrapped.bvh", "given_seconds.bvh"],
)  # fmt: skip
def test_a_kind_is_read_and_not_refused(name: str, tmp_path: Path) -> None:
    kind = next(kind for kind in KINDS if kind.file == name)
    assert outcome(kind, tmp_path)[0].startswith("as the reference")


_SEATED = {1: about("x", -90), 2: about("x", -90)}


@pytest.mark.parametrize("degrees", [-60, 38])
@pytest.mark.parametrize(
    "frames",
    [{}, HANGING, _SEATED, turned(30), turned(9), _whole(about("x", -90)),
     _whole(about("y", 30) @ about("x", -90)), _whole(about("x", 20)), _whole(about("z", 45)),
     _whole(about("y", 30), _SEATED)],
    ids=["T", "A", "seated", "turned", "little", "lies", "lies_turned", "leans", "aslant", "sits"],
)  # fmt: skip
def test_a_trunk_ahead_or_behind_turns_nothing(
    frames: Turns, degrees: float, tmp_path: Path
) -> None:
    """Whatever the rest pose: legs and trunk say where up is."""
    content = bvh(frames=frames, rest_cm=trunk_cm(degrees))
    motion = Kind("walk.bvh", "", lambda: content).read(tmp_path)[0]
    turn_deg, place_m = apart(motion, KINDS[0].read(tmp_path)[0])
    assert (turn_deg < MOST_DEG, place_m < MOST_M) == (True, True), (turn_deg, place_m)


@pytest.mark.parametrize(
    ("joints", "ahead_cm"),
    [((12,), -16), ((12,), 20), ((12, 15), 15), ((15,), 20), ((9,), -15), ((6,), 12), ((3, 6), 14)],
)
def test_single_joints_ahead_or_behind_turn_nothing(
    joints: tuple[int, ...], ahead_cm: float, tmp_path: Path
) -> None:
    rest = REST_CM.copy()
    rest[list(joints), 2] += ahead_cm
    motion = Kind("walk.bvh", "", lambda: bvh(rest_cm=rest)).read(tmp_path)[0]
    assert apart(motion, KINDS[0].read(tmp_path)[0])[0] < MOST_DEG


@pytest.mark.parametrize("frame_time", ["0", "1/60", "16.7", "-0.0167"])
def test_a_frame_time_of_no_motion_is_named_or_replaced(frame_time: str, tmp_path: Path) -> None:
    content = edited((r"^Frame Time.*", f"Frame Time: {frame_time}"))
    with pytest.raises(DsnetError, match=f"'Frame Time' of {frame_time}.*--motion-fps"):
        Kind("walk.bvh", "", lambda: content).read(tmp_path)
    motion, said = Kind("walk.bvh", "", lambda: content, 60.0).read(tmp_path)
    assert apart(motion, KINDS[0].read(tmp_path)[0]) == (0, 0)
    assert any(f"'Frame Time' of {frame_time}" in line for line in said)


def test_a_prop_is_told_and_the_largest_skeleton_says_what_is_lacking(tmp_path: Path) -> None:
    said = Kind("walk.bvh", "", prop_first).read(tmp_path)[1]
    assert any("also holds Prop, " in line for line in said)
    with pytest.raises(DsnetError, match=r"has no left_elbow .it has Hips"):
        Kind("walk.bvh", "", lambda: prop_first().replace("LeftForeArm", "Left")).read(tmp_path)


def test_the_pages_table_is_what_comes_of_them(tmp_path: Path) -> None:
    """`python -m tests.forged.motion_kinds` writes it anew."""
    shown = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    assert shown == table(tmp_path)


@pytest.mark.parametrize("up", ["y", "z"])
def test_what_the_user_says_of_the_vertical_is_believed(up: Up, tmp_path: Path) -> None:
    arrays = {"y_up": smpl(poses=y_up(), trans=walk()[1]), "z_up": smpl()}
    found = [
        Kind(f"{name}.npz", "", lambda given=given: given, how=HowRead(up)).read(tmp_path)[0]
        for name, given in arrays.items()
    ]
    trunk = [Rotation.from_rotvec(m.pose[:, 0]).apply([0, 1, 0])[:, 1].mean() for m in found]
    assert [share > 0.9 for share in trunk] == [up == "y", up == "z"]


def test_a_body_that_lies_is_told(tmp_path: Path) -> None:
    lying = Kind("lies.npz", "", smpl, how=HowRead("y"))
    assert any("lies or bends down" in line for line in lying.read(tmp_path)[1])


@pytest.mark.parametrize(
    ("legs", "arms", "forearms"), [(180, 90, 90), (90, -90, 180), (-90, 180, -90), (0, 0, 90)]
)
def test_frames_turned_about_their_bones_are_told_by_the_motion(
    tmp_path: Path, legs: float, arms: float, forearms: float
) -> None:
    """No place of a joint tells; feet stand flat, to a degree or two."""
    frames = along_x(legs=legs, arms=arms, forearms=forearms)
    motion, said = Kind("x.bvh", "", lambda: bvh(frames=frames)).read(tmp_path)
    assert ["feet that point another way" in line for line in said] == [True]
    assert apart(motion, KINDS[0].read(tmp_path)[0])[0] < 2


def test_places_alone_give_limbs_their_directions(tmp_path: Path) -> None:
    """In any unit, and turned; twists of thighs come from the plane in which knees bend."""
    places = 39.37 * joints_m()
    motion = motion_from_joints(tmp_path, places, 20.0, AS_IT_SAYS)
    assert "0.0 cm from the file's in the mean" in motion.notes[-1]
    np.testing.assert_allclose(motion.trans_m, walk()[1], atol=1e-3)
    turns = [Rotation.from_rotvec(pose.reshape(-1, 3)) for pose in (motion.pose, walk()[0])]
    apart_deg = np.degrees((turns[0].inv() * turns[1]).magnitude()).reshape(FRAMES, 22)
    assert apart_deg[:, 0].max() < 1e-6
    assert apart_deg[:, [3, 6, 9]].max() < 10  # which of them a spine's twist is in, no place tells
    assert apart_deg[:, [1, 2, 4, 5]].mean() < 5
    z_up = motion_from_joints(tmp_path, places[..., [0, 2, 1]] * [1, -1, 1], 20.0, AS_IT_SAYS)
    np.testing.assert_allclose(z_up.theta, motion.theta, atol=1e-6)


def test_a_map_of_joints_is_lines(tmp_path: Path) -> None:
    path = tmp_path / "map.txt"
    for begin in ("# ours\n", "", "\ufeff"):
        path.write_text(f"{begin}left_hip = Bip01 L Thigh\n\nhead=Kopf\n", encoding="utf-8")
        assert read_joint_map(path) == {"left_hip": "Bip01 L Thigh", "head": "Kopf"}
    for text in ("left_hip\n", "a = b\na = c\n", "\xff"):
        path.write_bytes(text.encode("latin-1"))
        with pytest.raises(DsnetError, match="--joint-map") as caught:
            read_joint_map(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("joint_map", "complaint"),
    [({"left_hipp": "LeftUpLeg"}, "left_hipp"), ({"left_hip": "LeftUpLegg"}, "LeftUpLegg")],
)
def test_a_map_of_what_there_is_not_is_refused(
    tmp_path: Path, joint_map: dict[str, str], complaint: str
) -> None:
    with pytest.raises(DsnetError, match=complaint):
        Kind("walk.bvh", "", KINDS[0].content, how=HowRead(joint_map=joint_map)).read(tmp_path)
    with pytest.raises(DsnetError, match="with a BVH"):
        Kind("walk.npz", "", smpl, how=HowRead(joint_map=joint_map)).read(tmp_path)


@cache
def reference(name: str) -> Motion:
    return load_motion(CASES / name)


@pytest.mark.skipif(not CASES.is_dir(), reason="no $DSNET_TEST_CASES")
@pytest.mark.parametrize("pattern", ["*.bvh", "*.BVH", "*.npz", "*.pkl", "*.npy", "*.smpl"])
def test_no_case_of_others_is_silently_another_motion(pattern: str) -> None:
    """Right within a degree and a centimetre, refused, or told."""
    for path in sorted(CASES.glob(pattern)):
        kind = "bvh" if path.suffix.lower() == ".bvh" else "npz"
        bounce = path.name.startswith("38_")
        other = "38_bounce_120fps.npz" if bounce else f"00_reference.{kind}"
        try:
            motion = load_motion(path, 60.0 if path.name.startswith(("54", "65")) else None)
        except DsnetError:
            continue
        trunk = Rotation.from_rotvec(motion.pose[:, 0]).apply([0.0, 1.0, 0.0])
        assert np.median(trunk[:, 1]) > 0.9, path
        turn_deg, place_m = apart(motion, reference(other))
        said = motion_warnings(motion)
        assert (turn_deg < MOST_DEG and place_m < MOST_M) or said, (path, turn_deg, place_m)
