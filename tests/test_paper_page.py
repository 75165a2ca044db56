"""docs/paper.md leads from every equation, section and figure to the definition that does it."""

from __future__ import annotations

import re

import pytest

from tests.sources import ROOT, defined_names
from torch_align_ae.alignment.stage_align import PROFILES as ALIGN
from torch_align_ae.autoencoder.stage_train_ae import PROFILES as TRAIN_AE

PAGE = ROOT / "docs" / "paper.md"
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


def test_the_lengths_of_trainings_are_the_profiles() -> None:
    text = PAGE.read_text()
    code, steps = TRAIN_AE["paper"], ALIGN["paper"].steps
    assert f"| autoencoder | {code.epochs} epochs of 236 steps |" in text
    assert f"preset `{code.comparisons[0]}` | {code.comparison_epochs} epochs, only" in text
    assert f"| {steps} steps a frame |" in text
    networks = (ROOT / "dsnet" / "stages" / "stage_train.py").read_text()
    epochs, rounds = re.findall(r'run="paper", epochs=(\d+), .*rounds=(\d+)\)', networks)[0]
    assert f"| DSNet, both presets | {int(epochs):,} epochs of 5 batches" in text
    assert f"| `dsnet_plus` | {rounds} rounds of" in text
