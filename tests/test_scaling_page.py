"""The page of what was measured shows the committed results."""

from __future__ import annotations

from tests.benchmarks.test_scaling import measured
from tools.update_scaling import PAGE, load, page


def test_the_page_is_up_to_date():
    assert page(load("scaling"), load("many_sequences")) == PAGE.read_text(encoding="utf-8")


def test_a_measurement_gives_all_tables():
    phase = {"read_bytes": 1, "written_bytes": 1, "sent_bytes": 1, "back_bytes": 1}
    corpora = [measured(frames, workers) for frames in (200, 500, 900) for workers in (1, 2)]
    for one in corpora:
        one["phases"]["fit"] |= phase
    scaling = {"machine": "a machine", "profile": "demo", "measured": corpora, "overheads": [],
               "manifest_bytes": 160.0, "digest_mb_s": 400.0}  # fmt: skip
    text = page(scaling, load("many_sequences"))
    assert text.count("\n| align |") == len(corpora) + 4 + 1
    assert "nodes for a day" in text
