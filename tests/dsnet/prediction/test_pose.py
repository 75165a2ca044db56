"""`--pose bony`: the bounce that a pose was fitted to is taken out of it, and said."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import load_motion
from dsnet.cli import main
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.moving_body import MovingBody
from tests.forged.c3d import c3d
from tests.forged.markers import VERTICES, Known, pose_arrays, sampled, stageii

BOB_M = 0.03


def bobbing() -> dict[str, Any]:
    """A pose that bobs at 3 Hz, as if it had been fitted to flesh."""
    arrays = pose_arrays()
    seconds = np.arange(len(arrays["trans"])) / 60
    trans = np.array(arrays["trans"], np.float64)
    trans[:, 2] += BOB_M / 2 * np.sin(2 * np.pi * 3 * seconds)
    return arrays | {"trans": trans}


def in_npz(folder: Path, known: Known) -> Path:
    markers = {"marker_data": sampled(known), "marker_labels": np.array(list(VERTICES))}
    np.savez(folder / "take.npz", **bobbing() | markers)
    return folder / "take.npz"


def beside_c3d(folder: Path, known: Known) -> Path:
    (folder / "take.c3d").write_bytes(c3d(1e3 * sampled(known), list(VERTICES)))
    np.savez(folder / "take.npz", **bobbing())
    return folder / "take.npz"


def of_mosh(folder: Path, known: Known) -> Path:
    stored = stageii(known) | {"trans": bobbing()["trans"]}
    (folder / "take_stageii.pkl").write_bytes(pickle.dumps(stored))
    return folder / "take_stageii.pkl"


def moved(path: Path, controls: Controls) -> MovingBody:
    trained, motion = Controls().load(None, None, path)
    return controlled_body(trained, motion, controls)


@pytest.mark.parametrize("make", [in_npz, beside_c3d, of_mosh])
def test_the_bounce_is_taken_out_and_said(
    known: Known, tmp_path: Path, capsys: pytest.CaptureFixture[str], make: Any
) -> None:
    path = make(tmp_path, known)
    true = known.motion.trans_m
    off = [
        np.std((moved(path, Controls(pose=pose)).motion.trans_m - true)[:, 1])
        for pose in ("file", "bony")
    ]
    assert off[0] > 0.01
    assert off[1] < 0.004
    (found_mm,) = re.findall(r"takes (\d+) mm", capsys.readouterr().err)
    assert int(found_mm) == pytest.approx(1e3 * BOB_M, rel=0.25)


def test_another_shape_moves_by_the_bony_pose(known: Known, tmp_path: Path) -> None:
    path, betas = in_npz(tmp_path, known), "2,1,0,0,0,0,0,0,0,0"
    own = moved(path, Controls(pose="bony")).motion
    other = moved(path, Controls(pose="bony", betas=betas)).motion
    np.testing.assert_array_equal(other.pose, own.pose)
    np.testing.assert_allclose(np.ptp(other.trans_m - own.trans_m, axis=0), 0, atol=1e-9)


@pytest.mark.usefixtures("blank_strip")
def test_the_command_does_it_and_records_it(
    known: Known, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = in_npz(tmp_path, known), tmp_path / "out"
    main(["predict", "--motion", str(path), "--out", str(out), "--pose", "bony"])
    assert '"pose": "bony"' in (out / "manifest.json").read_text()
    assert "counts twice" not in capsys.readouterr().err
    main(["predict", "--motion", str(path), "--out", str(out)])
    said = capsys.readouterr().err.splitlines()
    assert sum("fitted to markers on skin" in line for line in said) == 1


def test_dmpls_without_markers_are_told_and_cannot_be_taken_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arrays: dict[str, Any] = bobbing() | {"dmpls": np.ones((240, 8))}
    np.savez(tmp_path / "take.npz", **arrays)
    moved(tmp_path / "take.npz", Controls()).announce()
    assert "fitted to skin with dmpls" in capsys.readouterr().err
    with pytest.raises(DsnetError, match="which has dmpls but no markers"):
        moved(tmp_path / "take.npz", Controls(pose="bony"))


def test_without_markers_nothing_is_said_and_bony_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = Path("sample:jumping_jacks")
    moved(path, Controls()).announce()
    assert "fitted" not in capsys.readouterr().err
    with pytest.raises(DsnetError, match=r"which has no markers.*\.c3d of the same name"):
        moved(path, Controls(pose="bony"))


@pytest.mark.parametrize(
    ("frames", "moved_m", "said"),
    [
        (240, 2.0, "jumps at 2.00 s"),
        (6, 0.0, "expected at least 2 s"),
        (1, 0.0, "expected at least 2 s"),
    ],
)
def test_over_cuts_and_in_no_time_nothing_is_smoothed(
    known: Known, tmp_path: Path, frames: int, moved_m: float, said: str
) -> None:
    arrays = {n: a[:frames] if a.shape[:1] == (240,) else a for n, a in pose_arrays().items()}
    points = sampled(known)[:frames]
    later = np.arange(frames) >= 120
    points[later, :, 0] += moved_m
    arrays["trans"] = arrays["trans"] + moved_m * later[:, None] * [1.0, 0.0, 0.0]
    markers = {"marker_data": points, "marker_labels": np.array(list(VERTICES))}
    stored: dict[str, Any] = arrays | markers
    np.savez(tmp_path / "take.npz", **stored)
    with pytest.raises(DsnetError, match=said):
        moved(tmp_path / "take.npz", Controls(pose="bony"))
    assert moved(tmp_path / "take.npz", Controls()).motion.theta.shape == (frames, 69)


def test_markers_of_another_rate_are_refused(known: Known, tmp_path: Path) -> None:
    path = beside_c3d(tmp_path, known)
    points = 1e3 * sampled(known)[:150]
    (tmp_path / "take.c3d").write_bytes(c3d(points, list(VERTICES), fps=100.0))
    with pytest.raises(DsnetError, match="one rate"):
        moved(path, Controls(pose="bony"))
    assert load_motion(path).source_fps == 60
