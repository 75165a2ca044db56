"""Blocks of pages are what the command writes; links, names and commands on pages are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.skin_markers.recovery import MODES
from tests.fuzz.readers import READERS
from tests.pages import PAGES, ROOT, commands_on, flags_of
from tools.pages.blocks import load, replaced
from tools.pages.readme import best_of
from tools.pages.reliability import damaged
from tools.pages.speed import limit_and_ms
from tools.update_pages import WRITTEN, written

REPORTS = sorted((ROOT / "docs" / "results").glob("*/report.md"))
NOT_PROSE = re.compile(r"<!--.*?-->|```.*?```|^ {4}.*?$|^\|.*?$", re.DOTALL | re.MULTILINE)
OTHERS = {("docs/results/motion_kinds.md", "kinds")}
"""Blocks that another command writes, of no results file."""


@pytest.mark.parametrize("page", WRITTEN)
def test_what_the_command_writes_is_what_is_committed(page: str) -> None:
    assert written(page) == (ROOT / page).read_text(encoding="utf-8")


def test_every_block_of_the_pages_is_written_by_the_command() -> None:
    blocks = {
        (page, name)
        for page in {*PAGES, *WRITTEN}
        for name in re.findall(r"<!-- (?!end\b)(\w+)", (ROOT / page).read_text(encoding="utf-8"))
    }
    made = {(page, name) for page, of in WRITTEN.items() if not callable(of) for name in of}
    assert blocks == made | OTHERS


def test_a_block_is_replaced_and_one_that_is_missing_is_told() -> None:
    page = "a\n<!-- b: by c -->\nold\n<!-- end -->\n<!-- d -->\nstays\n<!-- end of d -->\n"
    assert replaced(page, "b", "new\n") == page.replace("old", "new")
    with pytest.raises(ValueError, match="0 blocks `e`"):
        replaced(page, "e", "")


def test_a_cell_names_the_nearer_limit() -> None:
    part = {"times_moving": 9.0, "times_multiplying": 2.5, "ms": 40.0}
    assert limit_and_ms(part) == "2.5 products, 40.0 ms"
    assert limit_and_ms(part | {"times_moving": 1.5}) == "1.5 moving, 40.0 ms"


def test_the_verdict_is_of_the_better_predictor_and_its_own_smpl() -> None:
    scores = {"smpl": 4.0, "smpl_best": 5.0, "a": 3.0, "b": 2.0, "dsnet_plus": 1.0}
    cell = {name: {"mesh": {"r2": 0.5, "mean_mm": mm}} for name, mm in scores.items()}
    pipelines = {"paper": {"predictors": ["a", "b"]}, "best": {"predictors": ["dsnet_plus"]}}
    results = {
        "cells": {"validation": cell},
        "pipelines": pipelines,
        "predictors": scores,
        "seeds": None,
    }
    assert best_of(results, "validation") == ((4.0, 2.0), "0.50")
    assert best_of(results, "validation", "best") == ((5.0, 1.0), "0.50")


def test_no_fault_was_silent_and_every_damaged_file_was_read_or_refused() -> None:
    outcomes = [outcome for one in load("reliability/faults")["counts"].values() for outcome in one]
    assert outcomes
    assert not [outcome for outcome in outcomes if "silent" in outcome]
    assert sum(one["inputs"] for one in damaged("fuzz")) >= 100_000
    for campaign in (damaged("fuzz"), damaged("fuzz_guided")):
        assert len(campaign) == len(READERS)
        assert not any(one["other"] for one in campaign)
        assert max(one["max_rss_mb"] for one in campaign) <= 1024
    assert load("reliability/checksums")["share"] <= 0.05


def test_the_papers_size_fits_and_survives() -> None:
    full_size = load("reliability/full_size")
    stages = full_size["stages"].values()
    assert (full_size["frames"], len(stages)) == (21_502, 10)
    assert max(one["anonymous_mb"] for one in stages) <= full_size["limit_mb"]
    assert not any(one["differ"] for one in stages)
    assert [kill["found"] for one in stages for kill in one["kills"]].count("cut") >= 10


def test_all_engines_agreed_and_fits_by_markers_on_bone_find_the_truth() -> None:
    parity = load("verify/parity")
    assert parity["passed"]
    assert all(row["passed"] for row in parity["rows"])
    by_bone = load("skin_markers/recovery")["chest"][MODES[2]]
    frequency, damping, _ = by_bone["median"]
    assert (frequency <= 0.06, damping <= 0.12, min(by_bone["held"]) >= 0.8) == (True, True, True)


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.parent.name)
def test_published_reports_say_synthetic(report: Path) -> None:
    assert "\n**Synthetic data.** " in report.read_text(encoding="utf-8")[:100]


def test_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(NOT_PROSE.sub("", text).split()) <= 1_000


@pytest.mark.parametrize("page", PAGES)
def test_links_and_named_files_lead_to_files(page: str) -> None:
    path = ROOT / page
    text = path.read_text(encoding="utf-8")
    links = re.findall(r"(?:\]\(|src=\")(?!https?://)([^)#\"]+)", text)
    folders = "benchmarks|bridge|dsnet|docs|tests|tf_dsnet|tools|torch_align_ae"
    named = re.findall(rf"`((?:{folders})/[\w./-]+)", text)
    places = {*(path.parent / link for link in links), *(ROOT / name for name in named)}
    assert not [place for place in places if not place.exists()]


@pytest.mark.parametrize("page", PAGES)
def test_commands_on_pages_exist(page: str) -> None:
    script = (ROOT / "reproduce.sh").read_text(encoding="utf-8")
    for line in commands_on(page):
        if "./reproduce.sh" in line:
            assert not [flag for flag in flags_of(line) if flag not in script], line
        for module in re.findall(r"python -m ((?:benchmarks|tests|tools)[\w.]*)", line):
            path = ROOT / module.replace(".", "/")
            assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), line
        for file in re.findall(r"python (\w\S+\.py)", line):
            assert (ROOT / file).exists(), line
