"""Recordings without a pose: of a woman who walks, whose pose, shape and flesh are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.posing import Smpl, posed_joints, shaped_joints
from bridge.body.surface_operators import vertex_normals
from bridge.motion import load_motion, unpack_theta
from bridge.motion.motion import Y_UP_FROM_Z_UP
from dsnet.fitting.train import subjects_of
from dsnet.markers.bony_fit import _Skin
from dsnet.markers.lone import Lone, lone_motion, measure_alone
from dsnet.markers.marker_files import is_lone
from dsnet.markers.places import ON_BONE, SAME_PLACE, bony_vertices
from dsnet.stages import stage_evaluate
from tests.forged.c3d import c3d
from tests.forged.markers import Known, marker_file

BODY = load_body_model("embedded:female")
BETAS = np.array([1.2, -1.0, 0.8, 0, 0, 0, 0, 0, 0, 0])
SOFT = {"LTHI": (0.2, -0.22, 0.0), "RTHI": (-0.2, -0.25, 0.0), "LTIB": (0.2, -0.6, -0.02),
        "LBUST": (0.116, 0.289, 0.143), "MBLLY": (0.016, 0.123, 0.121)}  # fmt: skip
PLUG_IN_GAIT = [
    *("C7", "T10", "CLAV", "STRN", "RBAK"),
    *(f"{side}{name}" for side in "LR" for name in
      ("FHD", "BHD", "SHO", "ELB", "IWR", "OWR", "FIN", "ASI", "PSI", "KNE", "ANK", "HEE", "TOE")),
]  # fmt: skip
MOTION = load_motion("sample:walking")
OWN = replace(MOTION, betas=BETAS).about_root_joint(shaped_joints(BODY, BETAS[None])[0, 0])
SECONDS = np.arange(len(OWN.theta)) / OWN.fps
SWINGS_M = 0.008 * np.sin(2 * np.pi * 5 * SECONDS)
"""What the soft markers do beyond bone, outwards."""


def places() -> dict[str, int]:
    """Vertices within 2 cm of where the markers should be: nobody sticks them on exactly."""
    rng, template = np.random.default_rng(0), BODY.v_template
    named = dict(zip(PLUG_IN_GAIT, bony_vertices(BODY, PLUG_IN_GAIT), strict=True))
    near = {
        label: np.flatnonzero(np.linalg.norm(template - template[v], axis=1) < 0.02)
        for label, v in named.items()
    }
    stuck = {label: int(rng.choice(rows)) for label, rows in near.items()}
    soft = {k: int(np.linalg.norm(template - p, axis=1).argmin()) for k, p in SOFT.items()}
    return stuck | soft


def recorded() -> dict[str, np.ndarray]:
    """(T, 3) places of each marker, metres, y up, a third of a millimetre of noise."""
    vertices = places()
    rows = [*vertices.values()]
    skin = np.asarray(Smpl(BODY, dtype=np.float64).person(BETAS).pose(*unpack_theta(OWN.theta)))
    out = np.stack([vertex_normals(frame, BODY.faces)[rows] for frame in skin])
    is_soft = np.array([label in SOFT for label in vertices])
    beyond_m = 0.0095 + SWINGS_M[:, None] * is_soft
    points_m = skin[:, rows] + beyond_m[..., None] * out
    points_m += 0.0003 * np.random.default_rng(1).standard_normal(points_m.shape)
    return {label: points_m[:, n] for n, label in enumerate(vertices)}


POINTS_M = recorded()
NAMES = {other: name for name, other in SAME_PLACE.items() if name[1:] in ("WRA", "WRB")}
"""As Plug-in Gait has them."""


def walk(path: Path, labels: list[str] | None = None) -> Path:
    """A C3D of some markers, millimetres, z up, with gaps."""
    labels = labels or [*POINTS_M]
    points_m = np.stack([POINTS_M[label] for label in labels], axis=1)
    z_up = Y_UP_FROM_Z_UP.inv().apply(points_m.reshape(-1, 3)).reshape(points_m.shape)
    z_up[60:66, 2] = np.nan
    z_up[100:112] = z_up[100]  # the recording froze
    path.write_bytes(c3d(1e3 * z_up, [f"Anna:{NAMES.get(label, label)}" for label in labels]))
    return path


def joints_off_mm(motion_betas: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(T, 22)."""
    _, true_m = posed_joints(BODY, BETAS, *unpack_theta(OWN.theta))
    _, found_m = posed_joints(BODY, motion_betas, *unpack_theta(theta))
    return 1e3 * np.linalg.norm(true_m - found_m, axis=2)[:, :22]


def test_a_walk_tells_pose_shape_and_what_is_soft(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lone = Lone.read(walk(tmp_path / "walk.c3d"))
    motion = lone_motion(BODY, lone)
    off_mm = joints_off_mm(motion.betas, motion.theta)
    assert np.median(off_mm) < 16
    assert np.quantile(off_mm, 0.95) < 32
    apart = Rotation.from_rotvec(OWN.pose[:, 0]).inv() * Rotation.from_rotvec(motion.pose[:, 0])
    assert np.degrees(np.median(apart.magnitude())) < 6
    heights = [np.ptp(BODY.v_template[:, 1] + BODY.shapedirs[:, 1] @ b)
               for b in (BETAS, motion.betas, np.zeros(10))]  # fmt: skip
    assert abs(heights[1] - heights[0]) < 0.5 * abs(heights[2] - heights[0])
    assert "31 markers on bone" in capsys.readouterr().err
    assert "11 of 240 frames of its markers repeat the one before" in lone.markers.note
    assert off_mm[100:112].max() < 80
    rows = {row.label: row for row in measure_alone(lone).rows}
    assert {*SOFT, "STRN"} == {*rows}
    for label in SOFT:
        x, _, z = rows[label].fast.rms_mm
        # The skin's normal is level there, but for the belly's markers; bone takes nothing of it.
        assert np.hypot(x, z) == pytest.approx(8 / np.sqrt(2), rel=0.25), label
        assert rows[label].fast.energy[2] > 0.6, label


def test_slopes_are_those_of_small_steps() -> None:
    labels = ["CLAV", "LKNE", "RIWR"]
    skin = _Skin(BODY, bony_vertices(BODY, labels))
    rng = np.random.default_rng(2)
    skin.step(rng.normal(0, 0.3, 10 + 9) * np.r_[np.ones(10), np.full(9, 0.03)])
    skin._by_bends = 0 * skin._by_bends  # which the slopes leave out
    turns = Rotation.from_rotvec(rng.normal(0, 0.4, (22, 3))).as_matrix()[None]
    root_m = np.array([[0.3, 0.9, -0.2]])
    now, step = skin.places(turns, root_m), 1e-6
    by_pose, by_person = skin.slopes_by_pose(now), skin.slopes_by_person(now, turns)
    for column in (0, 4, 13, 40, 56, 61, 67):
        if column < 66:
            small = np.zeros((22, 3))
            small.ravel()[column] = step
            there = turns @ Rotation.from_rotvec(small).as_matrix(), root_m
        else:
            there = turns, root_m + step * np.eye(3)[column - 66]
        moved = (skin.places(*there).places_m - now.places_m) / step
        np.testing.assert_allclose(by_pose[..., column], moved, atol=1e-5)
    for column in (0, 3, 10, 14):
        small = step * np.eye(19)[column]
        skin.step(small)
        moved = (skin.places(turns, root_m).places_m - now.places_m) / step
        skin.step(-small)
        np.testing.assert_allclose(by_person[..., column], moved, atol=1e-5)


@pytest.mark.parametrize("gender", ["female", "male"])
def test_places_on_bone_are_mirrored_and_on_the_skin(gender: str) -> None:
    body = load_body_model(f"embedded:{gender}")
    labels = [*ON_BONE]
    where = dict(zip(labels, body.v_template[bony_vertices(body, labels)], strict=True))
    for label in (label for label in labels if label[0] == "L"):
        mirrored = where["R" + label[1:]] * [-1, 1, 1]
        assert np.linalg.norm(where[label] - mirrored) < 0.01, label
    assert where["LKNE"][0] > where["LKNI"][0] > 0
    assert where["LASI"][2] > 0.05 > -0.03 > where["LPSI"][2]
    assert where["C7"][2] < 0 < where["CLAV"][2]
    assert where["ARIEL"][1] > where["LFHD"][1] > where["C7"][1] > where["CLAV"][1]


def test_a_page_of_a_walk_alone_and_beside_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = walk(tmp_path / "walk.c3d")
    stage_evaluate.main(stage_evaluate.EvaluateConfig(markers=path, out=tmp_path / "out"))
    said, page = capsys.readouterr().err, (tmp_path / "out/markers.md").read_text()
    assert "twice" not in said
    assert "## Markers alone" in page
    assert "## pose fitted to markers on bone" in page
    assert (tmp_path / "out/markers_alone.png").stat().st_size > 10_000
    assert (tmp_path / "out/markers.png").is_file()


def test_legs_alone_have_a_table_but_no_body(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = ["LASI", "RASI", "LPSI", "RPSI", "LKNE", "LANK", "LTHI", "LTIB"]
    path = walk(tmp_path / "walk.c3d", labels)
    stage_evaluate.main(stage_evaluate.EvaluateConfig(markers=path, out=tmp_path / "out"))
    page = (tmp_path / "out/markers.md").read_text()
    assert "too few markers on bone" in capsys.readouterr().err
    assert "| thigh side, left* | LTHI |" in page
    assert "Prediction" not in page


def test_markers_that_say_nothing_of_flesh_are_refused(tmp_path: Path) -> None:
    path = walk(tmp_path / "walk.c3d", ["LASI", "RASI", "LPSI", "LANK", "RTHI"])
    with pytest.raises(DsnetError, match="on soft places"):
        measure_alone(Lone.read(path))


def test_recordings_without_poses_are_one_persons_of_a_folder(tmp_path: Path) -> None:
    for name in ("a/1.c3d", "a/2.c3d", "b/1.c3d"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        walk(tmp_path / name, [*POINTS_M][: {"a/1.c3d": 30, "a/2.c3d": 29}.get(name, 28)])
    assert is_lone(tmp_path / "a/1.c3d")
    _, people, refused = subjects_of(tmp_path, None)
    assert sorted(len(person.files) for person in people) == [1, 2]
    assert not refused


def test_what_the_reader_of_a_file_says_is_told(
    known: Known, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(marker_file(tmp_path / "a.npz", known)) as stored:
        arrays = {name: stored[name] for name in stored if name != "trans"}
    np.savez(tmp_path / "a.npz", **arrays)
    subjects_of(tmp_path, None)
    assert "a.npz says nowhere where the body is" in capsys.readouterr().err
