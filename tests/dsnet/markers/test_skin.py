"""Markers with known truth: sampled from a body whose offsets are known, with noise and gaps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion import unpack_theta
from bridge.motion.theta import pack_theta
from dsnet.markers.bone_pose import bone_motion
from dsnet.markers.comparison_files import write_comparisons
from dsnet.markers.registration import Registered, register
from dsnet.markers.segments import Pose
from dsnet.markers.skin import Comparison, compare_offsets
from tests.forged.amass import save, smplh
from tests.forged.markers import VERTICES, Known, marker_file, markers_in, sampled

LABELS = list(VERTICES)


def compared(known: Known, path: Path, part: float) -> Comparison:
    markers = markers_in(path)
    registered = register(known.body, known.motion, markers)
    return compare_offsets(known.body, known.motion, part * known.offsets_m, registered)


@pytest.mark.parametrize(("part", "r2"), [(1.0, 1.0), (0.5, 0.75), (0.0, 0.0)])
def test_true_half_and_no_offsets_have_their_r2(
    known: Known, tmp_path: Path, part: float, r2: float
) -> None:
    found = compared(known, marker_file(tmp_path / "m.npz", known), part)
    soft = [row for row in found.rows if row.region not in ("cheeks", "upper arm, right")]
    assert len(soft) == 8
    for row in soft:
        apart = known.body.v_template[[row.vertex, VERTICES[row.label]]]
        assert np.linalg.norm(np.diff(apart, axis=0)) < 0.015
        assert row.flesh_r2 == pytest.approx(r2, abs=0.02)
        assert row.total_r2_up == pytest.approx(1.0, abs=2e-3) or part < 1


def test_noise_and_gaps_cost_the_chest_little(known: Known, tmp_path: Path) -> None:
    path = marker_file(tmp_path / "m.npz", known, noise_m=0.0005, gaps=0.05)
    found = {row.label: row for row in compared(known, path, 1.0).rows}
    assert min(found[label].flesh_r2_up for label in ("LBUST", "RBUSTLO")) > 0.95
    assert found["LBUST"].seen < 1
    assert found["LBUST"].lag_ms == 0


def test_a_prediction_that_comes_late_is_told(known: Known, tmp_path: Path) -> None:
    path = marker_file(tmp_path / "m.npz", known)
    late = Known(known.body, known.motion, np.roll(known.offsets_m, 3, axis=0))
    row = next(row for row in compared(late, path, 1.0).rows if row.label == "LBUST")
    assert row.lag_ms == pytest.approx(-50.0)


def test_millimetres_are_told_and_read(known: Known, tmp_path: Path) -> None:
    path = marker_file(tmp_path / "m.npz", known, scale=1e3)
    assert "millimetres" in markers_in(path).note
    assert compared(known, path, 1.0).rows[0].flesh_r2 > 0.99


def test_markers_of_another_moment_are_refused(known: Known, tmp_path: Path) -> None:
    path = marker_file(tmp_path / "m.npz", known)
    stored = dict(np.load(path))
    stored["marker_data"] = stored["marker_data"][:, ::-1]  # head to foot
    np.savez(path, **stored)
    pose, trans = unpack_theta(known.motion.theta)
    lying = np.array(pose)
    lying[:, 0] = (np.pi / 2, 0, 0)
    theta = pack_theta(lying, trans)
    with pytest.raises(DsnetError, match="mm off the body"):
        register(known.body, replace(known.motion, theta=theta), markers_in(path))


def changed(known: Known, tmp_path: Path, points: NDArray, labels: list[str] | None = None) -> Path:
    """The known woman's file with other markers."""
    path = marker_file(tmp_path / "m.npz", known)
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays |= {"marker_data": points, "marker_labels": np.array(labels or LABELS)}
    np.savez(path, **arrays)
    return path


def registered_of(known: Known, path: Path) -> Registered:
    return register(known.body, known.motion, markers_in(path))


@pytest.mark.parametrize(("degrees", "apart_m"), [(0, 3.0), (30, 0.0), (101, 3.0), (180, 0.0)])
def test_a_world_turned_about_the_vertical_is_turned_back(
    known: Known, tmp_path: Path, degrees: float, apart_m: float
) -> None:
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    path = changed(known, tmp_path, sampled(known) @ turn.T + [apart_m, apart_m, 0.0])
    found = {row.label: row for row in compared(known, path, 1.0).rows}
    assert min(found[label].total_r2_up for label in ("LBUST", "MBLLY", "LTIB")) > 0.99


def test_markers_of_the_other_side_are_refused(known: Known, tmp_path: Path) -> None:
    other = {"L": "R", "R": "L"}
    exchanged = [other.get(k[0], k[0]) + k[1:] for k in LABELS]
    points = sampled(known)
    for path in (
        changed(known, tmp_path, points, exchanged),
        changed(known, tmp_path, points * [-1, 1, 1]),
    ):
        with pytest.raises(DsnetError, match="lie on the other side"):
            registered_of(known, path)


@pytest.mark.parametrize("frames", [1, 3])
def test_markers_that_begin_later_than_the_pose_are_refused(
    known: Known, tmp_path: Path, frames: int
) -> None:
    path = changed(known, tmp_path, sampled(known)[frames:])
    with pytest.raises(DsnetError, match=f"{frames / 60:.2f} s too early"):
        registered_of(known, path)


def test_after_their_last_frame_markers_are_not_seen(known: Known, tmp_path: Path) -> None:
    found = registered_of(known, changed(known, tmp_path, sampled(known)[:-5]))
    assert all(not seen[-5:].any() and seen[:-5].all() for seen in found.cloud.seen.values())


@pytest.mark.parametrize("value", [9999.0, -1.0, 1e-6])
def test_numbers_that_mean_unseen_are_no_places(known: Known, tmp_path: Path, value: float) -> None:
    points = sampled(known)
    points[80:84, LABELS.index("LBUST")] = value
    row = {row.label: row for row in compared(known, changed(known, tmp_path, points), 1.0).rows}
    assert row["LBUST"].seen < 1
    assert row["LBUST"].flesh_r2_up > 0.99


@pytest.mark.parametrize("frames", [12, 120])
def test_frames_that_are_repeated_are_told(known: Known, tmp_path: Path, frames: int) -> None:
    """Those of a short freeze are left out; a motion of which they are half stays as it is."""
    points = sampled(known)
    points[60 : 60 + frames] = points[60]
    markers = markers_in(changed(known, tmp_path, points))
    assert f"{frames - 1} of {len(points)} frames of its markers repeat" in markers.note
    assert np.isnan(markers.points_m[61 : 60 + frames]).all() == (frames < 50)
    assert np.isfinite(markers.points_m[60]).all()


def test_a_gap_that_was_filled_with_one_place_is_a_gap(known: Known, tmp_path: Path) -> None:
    points, bust = sampled(known), LABELS.index("LBUST")
    points[80:140, bust] = points[80, bust]
    found = registered_of(known, changed(known, tmp_path, points))
    assert not found.cloud.seen["LBUST"][81:140].any()
    assert found.cloud.seen["RBUSTLO"].all()


def test_a_marker_under_anothers_name_is_left_out_with_a_line(
    known: Known, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    exchange = {"LBUST": "LANK", "LANK": "LBUST"}
    labels = [exchange.get(label, label) for label in LABELS]
    found = registered_of(known, changed(known, tmp_path, sampled(known), labels))
    (line,) = capsys.readouterr().err.splitlines()
    assert "markers left out: LBUST, 1" in line
    assert set(LABELS) - {"LBUST"} == set(found.vertices) == set(found.cloud.points_m)


def test_a_vertex_that_a_file_states_wrongly_is_left_out_with_a_line(
    known: Known, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    markers = markers_in(marker_file(tmp_path / "m.npz", known))
    stated = replace(markers, vertices={**VERTICES, "LBUST": 331})
    found = register(replace(known.body, source="licensed"), known.motion, stated)
    assert "markers left out: LBUST, 4" in capsys.readouterr().err
    assert found.vertices == {k: v for k, v in VERTICES.items() if k != "LBUST"}


def test_a_motion_of_a_moment_is_refused(known: Known, tmp_path: Path) -> None:
    path = marker_file(tmp_path / "m.npz", known)
    short = replace(known.motion, theta=known.motion.theta[:20])
    with pytest.raises(DsnetError, match="at least 2 s"):
        register(known.body, short, markers_in(path))


@pytest.mark.parametrize("unseen", [np.nan, 0.0])
def test_moments_in_which_nothing_was_seen_are_bridged(
    known: Known, tmp_path: Path, unseen: float
) -> None:
    path = marker_file(tmp_path / "m.npz", known)
    stored = dict(np.load(path))
    stored["marker_data"][60:64] = unseen
    np.savez(path, **stored)
    row = next(row for row in compared(known, path, 1.0).rows if row.label == "LBUST")
    assert row.seen < 1
    assert row.flesh_r2_up > 0.95


@pytest.mark.parametrize(
    ("labels", "points", "words"),
    [
        ([f"*{i}" for i in range(25)], None, "without names"),
        (None, np.full((50, 25, 3), np.nan), "hardly ever seen"),
        (None, np.ones((50, 25, 3)), "apart"),
        (None, np.zeros((50, 25, 3)), "hardly ever seen"),
        (["a", "b"], None, "with 2 names"),
    ],
)
def test_what_are_no_markers_of_a_person_is_refused(
    known: Known, tmp_path: Path, labels: list[str] | None, points: NDArray | None, words: str
) -> None:
    path = marker_file(tmp_path / "m.npz", known)
    stored = dict(np.load(path))
    if points is not None:
        stored["marker_data"] = points
    if labels is not None:
        stored["marker_labels"] = np.array(labels)
    np.savez(path, **stored)
    with pytest.raises(DsnetError, match=words):
        markers_in(path)


def test_a_motion_without_markers_is_refused(tmp_path: Path) -> None:
    save(tmp_path / "m.npz", smplh(4))
    with pytest.raises(DsnetError, match="marker_data"):
        markers_in(tmp_path / "m.npz")


def test_markers_of_another_skeleton_are_refused(known: Known, tmp_path: Path) -> None:
    path = marker_file(tmp_path / "m.npz", known)
    stored = dict(np.load(path))
    stored["marker_labels"] = np.array([f"K{i}" for i in range(len(VERTICES))])
    np.savez(path, **stored)
    with pytest.raises(DsnetError, match="soft places"):
        compared(known, path, 1.0)


def test_markers_on_bone_take_the_bounce_out_of_a_pose(known: Known, tmp_path: Path) -> None:
    """The file's pose bobs by 30 mm with flesh; the chest of the markers does not."""
    path = marker_file(tmp_path / "m.npz", known, noise_m=0.0005)
    seconds = np.arange(len(known.motion.theta)) / known.motion.fps
    theta = np.array(known.motion.theta)
    theta[:, -2] += 0.03 * np.sin(2 * np.pi * 3 * seconds)  # up
    bobbing = replace(known.motion, theta=theta)
    registered = register(known.body, bobbing, markers_in(path))
    bony = bone_motion(known.body, bobbing, registered.cloud)
    chest = [known.motion, bobbing, bony]
    true, swallowed, mended = (
        Pose.of(known.body, motion).bones[:, SMPL_JOINT_NAMES.index("spine3")] @ [0, 1.3, 0, 1]
        for motion in chest
    )
    assert np.std((swallowed - true)[:, 1]) > 0.02
    assert np.std((mended - true)[:, 1]) < 0.006


def test_a_page_has_a_row_for_each_marker_and_a_figure(known: Known, tmp_path: Path) -> None:
    comparison = compared(known, marker_file(tmp_path / "m.npz", known), 1.0)
    write_comparisons(tmp_path.__truediv__, {"pose of the file": comparison}, known.motion.fps)
    rows = json.loads((tmp_path / "markers.json").read_text())["pose of the file"]["rows"]
    page = (tmp_path / "markers.md").read_text()
    assert all(f"| {row['label']} |" in page for row in rows)
    assert (tmp_path / "markers.png").stat().st_size > 10_000
