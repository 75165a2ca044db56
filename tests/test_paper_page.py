"""docs/paper.md leads from equations, sections and figures to the definitions that do them."""

from __future__ import annotations

import re

import pytest

from tests.sources import ROOT, defined_names

PAGE = ROOT / "docs" / "paper.md"
LINK = re.compile(r"\[`(?P<name>[\w.]+)`\]\((?P<path>[\w./]+\.py)\)")


@pytest.mark.parametrize(
    ("name", "path"), sorted(set(LINK.findall(PAGE.read_text(encoding="utf-8"))))
)
def test_the_file_defines_the_name(name: str, path: str) -> None:
    assert name in defined_names((PAGE.parent / path).resolve())
