"""docs/reliability.md shows the committed counts, and nothing passed silently."""

from __future__ import annotations

import pytest

from tests.fuzz.readers import READERS
from tools.update_reliability import CHECKSUMS, FAULTS, FULL_SIZE, FUZZ, PAGE, load, with_counts


def test_the_counts_are_up_to_date():
    page = PAGE.read_text()
    assert with_counts(page) == page


def test_nothing_was_silent():
    faults = load(FAULTS)
    assert faults is not None
    outcomes = [outcome for one in faults["counts"].values() for outcome in one]
    assert outcomes
    assert not [outcome for outcome in outcomes if "silent" in outcome]


@pytest.mark.skipif(not FUZZ.is_file(), reason="no campaign is committed yet")
def test_damaged_files_were_accepted_or_refused():
    fuzz = load(FUZZ)
    assert fuzz is not None
    readers = [counts for counts in fuzz.values() if isinstance(counts, dict)]
    assert len(readers) == len(READERS)
    assert sum(counts["inputs"] for counts in readers) >= 100_000
    assert [counts["other"] for counts in readers] == [0] * len(readers)
    assert max(counts["max_rss_mb"] for counts in readers) < 1500


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
