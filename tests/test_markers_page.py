"""What the page says of real markers is what the results file says."""

from __future__ import annotations

import json

from benchmarks.skin_markers.recovery import MODES, table
from tests.sources import ROOT


def test_the_pages_numbers_are_the_results() -> None:
    page = (ROOT / "docs" / "markers.md").read_text(encoding="utf-8")
    _, _, said = page.partition("<!-- numbers")
    said, _, _ = said.partition("<!-- end -->")
    stored = (ROOT / "docs" / "results" / "skin_markers" / "markers.json").read_text()
    of_file, bony = (
        [row for row in found["rows"] if row["region"].startswith("bust")]
        for found in json.loads(stored).values()
    )
    sizes = [row["real"]["peak_to_peak_mm"][1] for row in of_file]
    pose = [row["pose_peak_to_peak_up_mm"] for row in of_file]
    moved = [row["total_peak_to_peak_up_mm"] for row in bony]
    for left, right in (sizes, pose, moved):
        assert f"{left:.0f} and {right:.0f} mm" in said
    left, right = (row["total_r2_up"] for row in bony)
    assert f"{left:.2f} and {right:.2f}" in said
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    hers, its = (f"{one[0]:.0f} and {one[1]:.0f}" for one in (sizes, moved))
    assert f"by {its} mm where hers moves {hers} (R² {left:.2f} and {right:.2f})" in readme


def test_what_a_fitted_pose_costs_is_the_benchmarks() -> None:
    page = (ROOT / "docs" / "markers.md").read_text(encoding="utf-8")
    said = page.partition("<!-- fitted")[2].partition("<!-- end -->")[0]
    stored = (ROOT / "docs" / "results" / "skin_markers" / "marker_pose.json").read_text()
    for found in json.loads(stored)["motions"].values():
        fitted, bony = found.values()
        for key in ("r2_bust_offsets", "r2_bust_seen_up", "r2_offsets"):
            assert f"{fitted[key]:.2f} to {bony[key]:.2f}" in said
        assert f"{fitted['r2_bust_pose_alone']:.2f}" in said


def test_the_pages_table_of_recovery_is_the_results() -> None:
    page = (ROOT / "docs" / "markers.md").read_text(encoding="utf-8")
    _, _, said = page.partition("<!-- recovery")
    said, _, _ = said.partition("<!-- end -->")
    stored = json.loads((ROOT / "docs/results/skin_markers/recovery.json").read_text())
    assert said.partition("-->\n")[2] == table(stored)
    by_bone = stored["chest"][MODES[2]]
    frequency, damping, _ = by_bone["median"]
    assert frequency <= 0.06
    assert damping <= 0.12
    assert min(by_bone["held"]) >= 0.8
