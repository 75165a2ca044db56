"""Markers as MoSh++, AMASS and C3D store them, whole and damaged: the same recording from each."""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.markers import MarkerFile
from bridge.motion.readers import read_motion_file
from bridge.motion.readers.c3d import read_c3d
from dsnet.markers import marker_files
from dsnet.markers.marker_files import Markers, marker_file, markers_of
from dsnet.markers.registration import register
from dsnet.markers.segments import SEGMENTS
from tests.forged.c3d import c3d
from tests.forged.markers import (
    VERTICES,
    Known,
    markers_in,
    older_stageii,
    pose_arrays,
    sampled,
    stageii,
)
from tests.forged.markers import marker_file as amass_file

LABELS = list(VERTICES)


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion and the markers that its pose was fitted to."""

    motion: Motion
    markers: Markers


def load_recording(path: Path) -> Recording:
    motion = marker_files.load_recording(path)
    return Recording(motion, markers_of(motion))


def same_person(found: Recording, known: Known, apart_m: float = 1e-3) -> None:
    """The body moves as the known one, and its markers lie on it."""
    motion = found.motion.about_root_joint(known.body.joints[0])
    np.testing.assert_allclose(motion.theta, known.motion.theta, atol=1e-5)
    registered = register(known.body, known.motion, found.markers)
    assert set(registered.vertices) == set(LABELS)
    on_bone = {label for segment in SEGMENTS.values() for label in segment.labels}
    for label, distance_mm in registered.distance_mm.items():
        # Flesh that hangs is on average beside where it stands.
        assert distance_mm < 1e3 * apart_m + (15 if label in on_bone else 30), label


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_a_result_of_mosh_is_a_motion_with_markers(
    known: Known, tmp_path: Path, protocol: int
) -> None:
    path = tmp_path / "take_stageii.pkl"
    path.write_bytes(pickle.dumps(stageii(known), protocol))
    found = load_recording(path)
    same_person(found, known)
    assert found.motion.gender == "female"
    assert found.markers.vertices == VERTICES
    assert found.markers.fps == 60


@pytest.mark.parametrize("name", ["take_stageII.pkl", "chair_mo001.pkl"])
@pytest.mark.parametrize("protocol", [2, 5])
def test_the_older_layout_is_read_as_the_newer_one(
    known: Known, tmp_path: Path, protocol: int, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(pickle.dumps(older_stageii(known), protocol))
    found = load_recording(path)
    same_person(found, known)
    assert found.motion.gender == "female"
    there = [found.markers.labels.index(label) for label in LABELS]
    gaps = np.isnan(found.markers.points_m[:, there]).any(axis=2)
    np.testing.assert_array_equal(gaps, np.isnan(sampled(known, gaps=0.02)).any(axis=2))
    assert marker_file(path) == path


@pytest.mark.parametrize("by_frame", [True, False])
def test_the_older_layout_in_an_npz_is_read_too(
    known: Known, tmp_path: Path, by_frame: bool
) -> None:
    older = older_stageii(known)
    stored: dict[str, Any] = {str(key): value for key, value in older.items() if key != "ps"}
    stored["pose_est_obmrks"] = points = sampled(known)
    labels = [LABELS] * len(points) if by_frame else LABELS
    stored["pose_est_mrk_labels"] = np.array(labels)
    np.savez(tmp_path / "take.npz", **stored)
    same_person(load_recording(tmp_path / "take.npz"), known)


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        ([LABELS], "names of 1 frames beside places of"),
        ([[3]] * 240, "no text"),
        ("LBUST", "no list of names"),
        ([[f"{n}A"] for n in range(240)], "shape mismatch|could not"),
    ],
)
def test_names_of_the_older_layout_that_fit_nothing_are_refused(
    known: Known, tmp_path: Path, labels: Any, words: str
) -> None:
    fields = older_stageii(known)
    count = len(fields[np.str_("pose_est_obmrks")])
    if isinstance(labels, list) and len(labels) > 1:
        labels = labels[:1] * count if labels[0] == [3] else (labels * 2)[:count]
    if labels and labels[0] == [3]:
        fields["pose_est_obmrks"] = [np.zeros((1, 3))] * count
    (tmp_path / "take.pkl").write_bytes(pickle.dumps(fields | {"pose_est_mrk_labels": labels}))
    with pytest.raises(DsnetError, match=words) as caught:
        load_recording(tmp_path / "take.pkl")
    assert "\n" not in str(caught.value)


def test_every_other_frame_that_mosh_fitted_is_at_half_the_rate(
    known: Known, tmp_path: Path
) -> None:
    path = tmp_path / "take_stageii.pkl"
    path.write_bytes(pickle.dumps(stageii(known, per_frame=2)))
    assert load_motion(path).source_fps == 60


def test_a_pickle_of_another_numpy_is_read(known: Known, tmp_path: Path) -> None:
    raw = pickle.dumps(stageii(known), 2)
    renamed = raw.replace(b"numpy._core.", b"numpy.core.")
    if renamed == raw:
        renamed = raw.replace(b"numpy.core.", b"numpy._core.")
    assert renamed != raw
    (tmp_path / "take_stageii.pkl").write_bytes(renamed)
    same_person(load_recording(tmp_path / "take_stageii.pkl"), known)


def test_ten_thousand_frames_of_67_markers_are_not_too_many(tmp_path: Path) -> None:
    frames, labels = 10_000, [f"MARK{n}X" for n in range(67)]
    seen = np.random.default_rng(0).random((frames, 67)) > 0.01
    points = np.random.default_rng(0).random((frames, 67, 3))
    details = {
        "markers_orig": points,
        "labels_orig": labels,
        "mocap_frame_rate": 120,
        "markers_sim": [points[t, seen[t]] for t in range(frames)],
        "markers_obs": [points[t, seen[t]] for t in range(frames)],
        "labels_obs": [[labels[n] for n in np.flatnonzero(seen[t])] for t in range(frames)],
    }
    stored = {
        "fullpose": np.zeros((frames, 156)),
        "trans": np.zeros((frames, 3)),
        "betas": np.zeros(16),
        "stageii_debug_details": details,
    }
    path = tmp_path / "long_stageii.pkl"
    path.write_bytes(pickle.dumps(stored))
    markers = read_motion_file(path).markers
    assert markers is not None
    assert markers.stored.points.shape == (frames, 67, 3)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda raw: raw[: len(raw) // 2], "does not load"),
        (lambda raw: b"<html>" + raw, "does not load"),
        (lambda raw: b"", "does not load"),
        (lambda raw: pickle.dumps({"v_template": 1}), "without poses of SMPL"),
        (lambda raw: raw.replace(b"markers_orig", b"markers_none"), "without 'markers_orig'"),
    ],
)
def test_a_damaged_pickle_is_refused(
    known: Known, tmp_path: Path, damage: Callable[[bytes], bytes], words: str
) -> None:
    path = tmp_path / "take_stageii.pkl"
    path.write_bytes(damage(pickle.dumps(stageii(known))))
    with pytest.raises(DsnetError, match=words) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)


def beside(tmp_path: Path, raw: bytes, pose: str = "take.npz") -> Path:
    """A C3D and its pose."""
    arrays: dict[str, Any] = dict(pose_arrays())
    np.savez(tmp_path / pose, **arrays)
    (tmp_path / "take.c3d").write_bytes(raw)
    return tmp_path / "take.c3d"


@pytest.mark.parametrize(
    ("form", "apart_m"),
    [
        ({}, 1e-6),
        ({"units": "m"}, 1e-6),
        ({"processor": 86}, 1e-6),
        ({"processor": 85}, 1e-6),
        ({"scale": 0.1}, 1e-4),
        ({"scale": 0.1, "processor": 86}, 1e-4),
        ({"analog": 12}, 1e-6),
    ],
)
def test_every_form_of_c3d_is_read(
    known: Known, tmp_path: Path, form: dict[str, Any], apart_m: float
) -> None:
    points = sampled(known, gaps=0.02)
    per_m = 1.0 if form.get("units") == "m" else 1000.0
    path = beside(tmp_path, c3d(per_m * points, [f"Anna:{one}" for one in LABELS], **form))
    found = load_recording(path)
    same_person(found, known, 1.0)
    whole = markers_in(amass_file(tmp_path / "whole.npz", known))
    gaps = np.isnan(found.markers.points_m).any(axis=2)
    np.testing.assert_array_equal(gaps, np.isnan(points).any(axis=2))
    np.testing.assert_allclose(found.markers.points_m[~gaps], whole.points_m[~gaps], atol=apart_m)


@pytest.mark.parametrize("pose", ["take_poses.npz", "take_stageii.npz", "take.npz"])
def test_pose_and_c3d_find_each_other(known: Known, tmp_path: Path, pose: str) -> None:
    path = beside(tmp_path, c3d(1e3 * sampled(known), LABELS), pose)
    assert load_recording(path).motion.source == tmp_path / pose
    assert marker_file(tmp_path / pose) == path
    path.unlink()
    assert marker_file(tmp_path / pose) is None


def test_an_axis_that_is_not_up_is_told_by_heads_and_feet(known: Known, tmp_path: Path) -> None:
    y_up = sampled(known) @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    same_person(load_recording(beside(tmp_path, c3d(1e3 * y_up, LABELS))), known)


def test_a_rate_of_its_own_is_kept_and_a_wrong_one_is_the_poses(
    known: Known, tmp_path: Path
) -> None:
    points = 1e3 * sampled(known)
    twice = np.empty((2 * len(points) - 1, *points.shape[1:]))
    twice[::2], twice[1::2] = points, (points[1:] + points[:-1]) / 2
    found = load_recording(beside(tmp_path, c3d(twice, LABELS, fps=120.0)))
    assert found.markers.fps == 120
    same_person(found, known)
    found = load_recording(beside(tmp_path, c3d(points, LABELS, fps=100.0)))
    assert found.markers.fps == 60


def test_names_of_other_marker_sets_are_known(known: Known, tmp_path: Path) -> None:
    other = {
        "C7": "CV7",
        "T8": "TV8",
        "LASI": "LIAS",
        "RPSI": "RIPS",
        "LKNE": "LFLE",
        "LBAK": "LBAC",
    }
    names = [other.get(label, label) for label in LABELS]
    found = load_recording(beside(tmp_path, c3d(1e3 * sampled(known), names)))
    assert found.markers.labels == tuple(LABELS)


def test_angles_are_no_markers(known: Known, tmp_path: Path) -> None:
    points = 1e3 * sampled(known)
    more = np.concatenate([points, np.full((len(points), 1, 3), 4e4)], axis=1)
    path = beside(tmp_path, c3d(more, [*LABELS, "LHipAngles"], angles=["LHipAngles"]))
    assert load_recording(path).markers.labels == tuple(LABELS)


def two_people(points: np.ndarray) -> bytes:
    """One of whom has no prefix."""
    both = np.concatenate([points + np.array([900.0, 0.0, 0.0]), points], axis=1)
    return c3d(both, [*(f"B:{label}" for label in LABELS), *LABELS])


def test_props_beside_a_person_are_no_people(known: Known, tmp_path: Path) -> None:
    points = 1e3 * sampled(known)
    more = np.concatenate([points, points[:, :8] + [700.0, 0.0, 0.0]], axis=1)
    props = [*(f"Bat:P{n}" for n in range(4)), *(f"Q{n}" for n in range(4))]
    path = beside(tmp_path, c3d(more, [*(f"Anna:{label}" for label in LABELS), *props]))
    assert {*LABELS} < {*load_recording(path).markers.labels}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: c3d(p[:, :0], ["x"]), "without points"),
        (lambda p: c3d(p, [""] * len(LABELS)), "without names"),
        (lambda p: c3d(p, [f"*{n}" for n in range(len(LABELS))]), "without names"),
        (lambda p: c3d(p, [f"{'AB'[n % 2]}:{x}" for n, x in enumerate(LABELS)]), "one person"),
        (two_people, "markers of B and somebody else"),
        (lambda p: c3d(p, LABELS)[:-5000], "with the data of"),
        (lambda p: c3d(p, LABELS)[:600], "does not load"),
        (lambda p: b"GIF89a" + bytes(2000), "no C3D"),
        (lambda p: b"", "no C3D"),
        (lambda p: c3d(p / 1e3, LABELS), "apart"),
        (lambda p: c3d(p, LABELS, fps=0.0), "frames a second"),
    ],
)
def test_a_c3d_of_no_markers_is_refused(
    known: Known, tmp_path: Path, make: Callable[[np.ndarray], bytes], words: str
) -> None:
    path = beside(tmp_path, make(1e3 * sampled(known)))
    with pytest.raises(DsnetError, match=words) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)


def test_a_c3d_without_a_pose_is_refused(known: Known, tmp_path: Path) -> None:
    (tmp_path / "take.c3d").write_bytes(c3d(1e3 * sampled(known), LABELS))
    with pytest.raises(DsnetError, match=r"take\.npz .* beside it"):
        load_recording(tmp_path / "take.c3d")


def test_a_damaged_c3d_is_read_or_refused(known: Known, tmp_path: Path) -> None:
    """By nothing else than a refusal."""
    motion = load_motion("sample:walking")
    whole, refused = c3d(1e3 * sampled(known)[:90], LABELS, analog=3), 0
    for seed in range(300):
        chance = random.Random(seed)
        raw = bytearray(whole)
        for _ in range(chance.randint(1, 6)):
            raw[chance.randrange(1500)] = chance.choice([0, 127, 128, 255, chance.randrange(256)])
        path = tmp_path / "take.c3d"
        path.write_bytes(raw)
        try:
            markers_of(replace(motion, markers=MarkerFile(path, read_c3d)))
        except DsnetError:
            refused += 1
    assert 0 < refused < 300


@pytest.mark.parametrize("is_moshs", [False, True])
def test_markers_are_read_once(known: Known, tmp_path: Path, is_moshs: bool) -> None:
    """With the motion, or when they are first needed; a motion that is changed has them too."""
    path = tmp_path / "take_stageii.pkl"
    if is_moshs:
        path.write_bytes(pickle.dumps(stageii(known)))
    else:
        path = amass_file(tmp_path / "take.npz", known)
    motion = load_motion(path)
    first = None if is_moshs else markers_of(motion)
    path.unlink()
    again = markers_of(replace(motion, betas=np.ones(10)))
    assert first is None or np.array_equal(first.points_m, again.points_m)
    assert set(again.labels) == set(LABELS)
