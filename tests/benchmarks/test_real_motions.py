"""Files of others are read by hand as they are, and the page has what came of them."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.real_motions import FILES, HUMAN_IK, RealFile, bvh_places, compared, markdown
from tests.forged.motion_kinds import KINDS

DOCS = Path(__file__).parents[2] / "docs"
RESULT = DOCS / "results" / "real_motions.json"


def test_a_file_that_is_read_wrong_is_seen(tmp_path):
    """By hand with another vertical than the file has."""
    KINDS[0].read(tmp_path)
    path = tmp_path / KINDS[0].file
    names = [name for name in bvh_places(path) if name.endswith("LeftUpLeg")]
    assert names == ["LeftUpLeg"]
    right, wrong = (compared(path, RealFile("", "", HUMAN_IK, up)) for up in ("y", "z"))
    assert right["limbs_deg"] < 0.01
    assert wrong["limbs_deg"] > 60


def test_the_committed_table_is_that_of_its_numbers_and_meets_the_goal():
    found = json.loads(RESULT.read_text(encoding="utf-8"))["files"]
    assert found.keys() == FILES.keys()
    assert len({one["origin"] for one in found.values()}) >= 10
    for one in found.values():
        assert one["limbs_deg"] < 5
        assert one["worst_limb_deg"] < 5
        assert one["travel_cm_a_metre"] is None or one["travel_cm_a_metre"] < 2
    page = (DOCS / "results" / "motion_kinds.md").read_text(encoding="utf-8")
    table = page.partition("<!-- real -->\n")[2].partition("\n<!-- end of real -->")[0]
    assert table == markdown(RESULT)
