"""Markers in tables of text: the same as from a C3D, and each fault in a line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion.readers.recordings import recording, recording_beside
from dsnet.markers.lone import Lone
from dsnet.markers.marker_files import marker_file
from tests.forged.marker_tables import optitrack, qualisys, trc

LABELS = ["LFHD", "C7", "CLAV", "LASI", "RASI", "LHEE"]
RNG = np.random.default_rng(0)
HEIGHTS_M = np.array([1.7, 1.5, 1.4, 1.0, 1.0, 0.1])
POINTS_M = np.stack([RNG.normal(0, 0.2, (90, 6)), HEIGHTS_M + RNG.normal(0, 0.01, (90, 6)),
                     RNG.normal(0, 0.2, (90, 6))], axis=2)  # fmt: skip
POINTS_M[40:45, 2] = np.nan
Y_UP_MM = 1e3 * POINTS_M
Z_UP_MM = Y_UP_MM[..., [0, 2, 1]] * [1, -1, 1]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.trc", trc(Y_UP_MM, LABELS)),
        ("a.trc", trc(POINTS_M, LABELS, units="m", unseen="NaN")),
        ("a.trc", trc(Y_UP_MM, LABELS, unseen="0.00").replace("\nDataRate", "  \nDataRate")),
        ("a.trc", trc(Z_UP_MM, LABELS).replace("\n\n", "\n")),
        ("a.tsv", qualisys(Z_UP_MM, LABELS)),
        ("a.tsv", qualisys(Z_UP_MM, LABELS, unseen="", with_times=True)),
        ("a.tsv", qualisys(Z_UP_MM, LABELS).replace(".", ",")),
        ("a.TSV", "\ufeff" + qualisys(Z_UP_MM, LABELS)),
        ("a.csv", optitrack(POINTS_M, LABELS)),
    ],
)
def test_tables_say_what_was_recorded(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8", newline="")
    markers = Lone.read(tmp_path / name).markers
    assert [*markers.labels] == LABELS
    assert markers.fps == 60
    np.testing.assert_allclose(markers.points_m, POINTS_M, atol=1e-4)


CUT = qualisys(Z_UP_MM, LABELS)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "time,x,y,z\n0,1,2,3\n", "no table of markers"),
        ("a.csv", "", "no table of markers"),
        ("a.trc", "PathFileType\t4\n", "does not load"),
        (
            "a.trc",
            trc(Y_UP_MM, LABELS).replace("\n1\t0.00000\t", "\n1\t0.00000\tx"),
            "line 7: .* is no number",
        ),
        ("a.trc", trc(Y_UP_MM, LABELS)[:10_000], "a TRC of 90 frames"),
        ("a.trc", trc(Y_UP_MM, LABELS, fps=0.0001), "frames a second"),
        ("a.trc", trc(Y_UP_MM, [f"M{n}" for n in range(6)]).replace("M", ""), "without names"),
        ("a.tsv", CUT[: len(CUT) // 2], "a table of 90 frames"),
        ("a.tsv", CUT.replace("MARKER_NAMES", "NAMES"), "without MARKER_NAMES"),
        ("a.tsv", CUT.replace("FREQUENCY\t60", "FREQUENCY\tfast"), "'fast' is no number"),
        ("a.csv", optitrack(POINTS_M, LABELS).replace("Marker", "Bone"), "a table of 0 markers"),
        ("a.csv", optitrack(POINTS_M, LABELS).replace("Type", "Kind"), "types and names"),
    ],
)
def test_a_fault_is_a_line(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8", newline="")
    with pytest.raises(DsnetError, match=words) as caught:
        Lone.read(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("make", [trc, qualisys, optitrack])
def test_a_damaged_table_is_read_or_refused(tmp_path: Path, make: Callable[..., str]) -> None:
    whole, rng = make(Y_UP_MM[:20], LABELS).encode(), np.random.default_rng(1)
    suffix = {trc: ".trc", qualisys: ".tsv", optitrack: ".csv"}[make]
    for _ in range(150):
        raw = bytearray(whole)
        for at in rng.integers(0, 1200, 3):
            raw[at] = rng.choice([0, 9, 10, 44, 45, 255])
        (tmp_path / f"a{suffix}").write_bytes(raw)
        try:
            Lone.read(tmp_path / f"a{suffix}")
        except DsnetError:
            continue


def test_a_table_beside_a_pose_is_markers_if_its_name_says_so(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", poses=np.zeros((2, 156)))
    (tmp_path / "a.csv").write_text("time,x\n")
    assert recording_beside(tmp_path / "a.npz") is None
    (tmp_path / "a.trc").write_text(trc(Y_UP_MM, LABELS))
    assert recording_beside(tmp_path / "a.npz") == tmp_path / "a.trc"
    assert marker_file(tmp_path / "a.trc") == tmp_path / "a.trc"
    assert recording(tmp_path / "a.trc").stored.fps == 60
