"""docs/paper.md leads from every equation, section and figure to the definition that does it."""

from __future__ import annotations

import json
import re

import pytest

from tests.sources import ROOT, defined_names

PAGE = ROOT / "docs" / "paper.md"
RESULTS = ROOT / "docs" / "results" / "paper" / "results.json"
LINK = re.compile(r"\[`(?P<name>[\w.]+)`\]\((?P<path>[\w./]+\.py)\)")


def links() -> list[tuple[str, str]]:
    """Names and the files that the page gives for them, each pair once."""
    return sorted({(link["name"], link["path"]) for link in LINK.finditer(PAGE.read_text())})


def rows(section: str) -> list[str]:
    """The rows of one section's table, without its head."""
    body = PAGE.read_text().split(f"## {section}\n")[1].partition("\n## ")[0]
    return [line for line in body.splitlines() if line.startswith("|")][2:]


@pytest.mark.parametrize(("name", "path"), links())
def test_the_file_defines_the_name(name: str, path: str) -> None:
    assert name in defined_names((PAGE.parent / path).resolve())


@pytest.mark.parametrize("section", ["Equations", "Sections", "Tables and figures"])
def test_every_row_leads_to_code(section: str) -> None:
    assert [row for row in rows(section) if not LINK.search(row)] == []


@pytest.mark.parametrize("number", range(1, 6))
def test_every_numbered_equation_has_its_row(number: int) -> None:
    (row,) = [row for row in rows("Equations") if f"({number})" in row.split("|")[1]]
    assert LINK.search(row)


def test_the_readme_leads_to_the_page() -> None:
    assert "(docs/paper.md)" in (ROOT / "README.md").read_text()


def test_the_commands_of_the_run_say_where_it_was_cut() -> None:
    stages = json.loads(RESULTS.read_text())["stages"]
    code, network = (stages[stage]["config"] for stage in ("train-ae", "train"))
    cut = f"stop_epoch={code['stop_epoch']}, comparison_epochs={code['comparison_epochs']}"
    text = PAGE.read_text()
    assert f"main(['train-ae', '--profile', 'paper'], {cut})" in text
    assert f"dsnet train --profile paper --epochs {network['epochs']}\n" in text
