"""A reader's time is a budget: so many words of prose, so many pages of results."""

from __future__ import annotations

import re

import pytest

from tests.pages import PAGES, ROOT

PROSE, README, RESULTS = 14_000, 1_000, 12
"""At most: words of all pages, words of README, pages of results."""
NOT_PROSE = re.compile(r"<!--.*?-->|```.*?```|^ {4}.*?$|^\|.*?$", re.DOTALL | re.MULTILINE)


def words_of_prose(text: str) -> int:
    """Words outside of code blocks, tables and comments."""
    return len(NOT_PROSE.sub("", text).split())


def words_on(page: str) -> int:
    return words_of_prose((ROOT / page).read_text(encoding="utf-8"))


def test_what_is_prose() -> None:
    code = "```\na b\n```\n    c d\n"
    assert words_of_prose(f"One two.\n\n{code}| e | f |\n<!-- g\nh -->\n- three\n  four\n") == 5


def test_all_pages_are_read_in_an_hour() -> None:
    assert sum(map(words_on, (*PAGES, "CONTRIBUTING.md"))) <= PROSE


def test_readme_is_short() -> None:
    assert words_on("README.md") <= README


def test_architecture_fits_a_screen_or_two() -> None:
    assert words_on("docs/architecture.md") <= 500


def test_a_study_has_one_page() -> None:
    assert len(list((ROOT / "docs" / "results").rglob("*.md"))) <= RESULTS


@pytest.mark.parametrize("page", PAGES)
def test_tables_of_results_are_linked_not_pasted(page: str) -> None:
    """But for README's own, a row of a results page stands there alone."""
    if page == "README.md":
        return
    results = (ROOT / "docs" / "results").rglob("*.md")
    rows = {line for path in results for line in path.read_text(encoding="utf-8").splitlines()}
    shown = (ROOT / page).read_text(encoding="utf-8").splitlines()
    assert not [row for row in shown if row.startswith("| ") and row in rows]
