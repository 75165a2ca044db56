"""docs/reliability.md shows the committed counts, and nothing passed silently."""

from __future__ import annotations

from typing import Any

import pytest

from tests.fuzz.readers import READERS
from tools.update_reliability import (
    CHECKSUMS,
    FAULTS,
    FULL_SIZE,
    FUZZ,
    GUIDED,
    PAGE,
    load,
    with_counts,
)


def test_the_counts_are_up_to_date():
    page = PAGE.read_text()
    assert with_counts(page) == page


def test_nothing_was_silent():
    faults = load(FAULTS)
    assert faults is not None
    outcomes = [outcome for one in faults["counts"].values() for outcome in one]
    assert outcomes
    assert not [outcome for outcome in outcomes if "silent" in outcome]


def test_damaged_files_were_accepted_or_refused():
    fuzz = load(FUZZ)
    assert sum(counts["inputs"] for counts in of_readers(fuzz)) >= 100_000
    for counts in (*of_readers(fuzz), *of_readers(load(GUIDED))):
        assert counts["other"] == 0
        assert counts["max_rss_mb"] <= 1024


def of_readers(fuzz: dict[str, Any] | None) -> list[dict[str, Any]]:
    assert fuzz is not None
    readers = [counts for counts in fuzz.values() if isinstance(counts, dict)]
    assert len(readers) == len(READERS)
    return readers


@pytest.mark.skipif(not FULL_SIZE.is_file(), reason="not committed yet")
def test_the_papers_size_fits_and_survives():
    full_size = load(FULL_SIZE)
    assert full_size is not None
    assert full_size["frames"] == 21_502
    stages = full_size["stages"].values()
    assert len(stages) == 10
    assert max(one["anonymous_mb"] for one in stages) <= full_size["limit_mb"]
    assert [one["differ"] for one in stages] == [[]] * 10
    found = [kill["found"] for one in stages for kill in one["kills"]]
    assert found.count("cut") >= 10


def test_checksums_are_cheap():
    checksums = load(CHECKSUMS)
    assert checksums is None or checksums["share"] <= 0.05
