"""What stands beside the packages for strangers says what the project says elsewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import bridge
from tests.sources import ROOT, defined_names
from tests.test_paper_page import LINK

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PLACES = re.compile(r"(?<![\w./-])(?:[\w-]+/)+[\w.]*[\w/]")


def test_versions_agree() -> None:
    stated = re.search(r"^version: (.+)$", text("CITATION.cff"), re.MULTILINE)
    released = re.search(r"^## (\d.*) - \d{4}-\d\d-\d\d$", text("CHANGELOG.md"), re.MULTILINE)
    assert stated is not None
    assert released is not None
    assert stated[1] == released[1] == bridge.__version__


def test_the_papers_citation_is_readmes() -> None:
    cited = text("CITATION.cff").partition("preferred-citation:")[2]
    entry = dict(re.findall(r"^  (\w+) += \{(.*?)\},?$", text("README.md"), re.MULTILINE))
    for value in (entry["title"], entry["booktitle"], entry["year"]):
        assert re.sub("[{}]", "", value) in cited
    family_names = [author.split(",")[0] for author in entry["author"].split(" and ")]
    assert re.findall(r"family-names: (\w+)", cited) == family_names


def test_public_ci_runs_readmes_two_commands() -> None:
    commands = re.findall(r"- run: (.+)", text(".github/workflows/test.yml"))
    assert commands == ["./reproduce.sh", "./reproduce.sh test"]
    for command in commands:
        assert re.search(rf"^{re.escape(command)} +#", text("README.md"), re.MULTILINE)


@pytest.mark.parametrize(("name", "path"), sorted(set(LINK.findall(PAGE))))
def test_contributors_are_led_to_what_is_there(name: str, path: str) -> None:
    assert name in {*defined_names(ROOT / path), Path(path).name}


@pytest.mark.parametrize("place", sorted(set(PLACES.findall(re.sub(r"\]\(.*?\)", "", PAGE)))))
def test_contributors_find_the_places(place: str) -> None:
    assert "NAME" in place or (ROOT / place).exists() or place.startswith(".venv/")


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")
