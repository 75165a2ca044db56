"""docs/reliability.md shows the committed counts, and nothing passed silently."""

from __future__ import annotations

from tools.update_reliability import CHECKSUMS, FAULTS, PAGE, load, with_counts


def test_the_counts_are_up_to_date():
    page = PAGE.read_text()
    assert with_counts(page) == page


def test_nothing_was_silent():
    faults = load(FAULTS)
    assert faults is not None
    outcomes = [outcome for one in faults["counts"].values() for outcome in one]
    assert outcomes
    assert not [outcome for outcome in outcomes if "silent" in outcome]


def test_checksums_are_cheap():
    checksums = load(CHECKSUMS)
    assert checksums is None or checksums["share"] <= 0.05
