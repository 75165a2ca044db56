"""README's numbers are those of the committed results, and its links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dsnet.pictures.panels import FOOTERS
from tests.pages import PAGES, ROOT, commands_on, flags_of
from tools.speed_page import speed_page
from tools.update_readme import README, SPEED, load_bench, load_results, with_results

REPORTS = sorted((ROOT / "docs" / "results").glob("*/report.md"))


def test_generated_blocks_are_up_to_date() -> None:
    text = README.read_text(encoding="utf-8")
    shown = re.findall(r"<!-- (\w+): written by tools/update_readme.py -->", text)
    assert sorted(shown) == ["times", "verdict"]
    assert with_results(text, load_results("demo")) == text


def test_the_page_of_speed_is_up_to_date() -> None:
    assert SPEED.read_text(encoding="utf-8") == speed_page(load_bench(SPEED.parent))


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.parent.name)
def test_published_reports_claim_what_reports_claim_today(report: Path) -> None:
    assert f"*{FOOTERS['synthetic']}*" in report.read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("page", PAGES)
def test_named_files_exist(page: str) -> None:
    text = (ROOT / page).read_text()
    folders = "benchmarks|bridge|dsnet|docs|tests|tf_dsnet|tools|torch_align_ae"
    named = set(re.findall(rf"`((?:{folders})/[\w./-]+)", text))
    assert not [name for name in named if not (ROOT / name).exists()]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files(page):
    path = ROOT / page
    links = re.findall(r"(?:\]\(|src=\")(?!https?://)([^)#\"]+)", path.read_text())
    missing = [link for link in links if not (path.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES)
def test_other_commands_on_pages_exist(page: str) -> None:
    script = (ROOT / "reproduce.sh").read_text(encoding="utf-8")
    for line in commands_on(page):
        if "./reproduce.sh" in line:
            assert not [flag for flag in flags_of(line) if flag not in script], line
        for module in re.findall(r"python -m ((?:benchmarks|tests|tools)[\w.]*)", line):
            path = ROOT / module.replace(".", "/")
            assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), line
        for file in re.findall(r"python (\w\S+\.py)", line):
            assert (ROOT / file).exists(), line
