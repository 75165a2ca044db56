"""docs/scaling.md and the page of storage show the committed results."""

from __future__ import annotations

from benchmarks.storage.page import page
from tests.benchmarks.test_scaling import measured
from tools.update_scaling import PAGE, SCALING, STORAGE, load, with_plan


def test_the_plan_is_up_to_date():
    text = PAGE.read_text()
    assert with_plan(text, load(SCALING), load(STORAGE)) == text


def test_the_page_of_storage_is_up_to_date():
    stored = load(STORAGE)
    assert stored is not None
    assert STORAGE.with_suffix(".md").read_text() == page(stored)


def test_a_measurement_gives_all_tables():
    phase = {"read_bytes": 1, "written_bytes": 1, "sent_bytes": 1, "back_bytes": 1}
    corpora = [measured(frames, workers) for frames in (200, 500, 900) for workers in (1, 2)]
    for one in corpora:
        one["phases"]["fit"] |= phase
    scaling = {"machine": "a machine", "profile": "demo", "measured": corpora, "overheads": [],
               "manifest_bytes": 160.0, "digest_mb_s": 400.0}  # fmt: skip
    text = with_plan(PAGE.read_text(), scaling, None)
    assert text.count("\n| align |") == len(corpora) + 4 + 1
    assert "nodes for a day" in text
    assert "Storage is not measured yet." in text
