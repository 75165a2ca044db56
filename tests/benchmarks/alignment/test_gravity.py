"""Results from before gravity say so on their page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.alignment import compare_page
from benchmarks.alignment.gravity import RECORDED

ROOT = Path(__file__).parents[3]
FOLDER = Path("docs") / "results" / "alignment"
PAGES = {"compare_held_out": compare_page.markdown}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_what_its_results_say(name: str) -> None:
    results = json.loads((ROOT / FOLDER / f"{name}.json").read_text())
    page = (ROOT / FOLDER / f"{name}.md").read_text()
    assert page == PAGES[name](results)
    assert ("**Before gravity:**" in page) == ("gravity_m_s2" not in results)
    results.pop("gravity_m_s2", None)
    assert f"measured on {results['provenance']['finished_utc'][:10]}" in PAGES[name](results)
    assert "**Before gravity" not in PAGES[name]({**results, **RECORDED})
