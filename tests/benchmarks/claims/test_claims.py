"""The table of claims is made of the results files, and a verdict follows its numbers."""

from __future__ import annotations

import copy

import pytest

from benchmarks.claims.__main__ import PAGE, page
from benchmarks.claims.claims import claims
from benchmarks.claims.results import Results
from benchmarks.claims.row import FAILS, HOLDS, PART, Claim


@pytest.fixture(scope="module")
def results() -> Results:
    return Results()


def all_claims(results: Results) -> dict[str, Claim]:
    return {row.claim: row for of_subject in claims(results).values() for row in of_subject}


def test_the_page_is_made_of_the_results() -> None:
    """After a change: python -m benchmarks.claims."""
    assert PAGE.read_text(encoding="utf-8") == page()


def test_verdicts_turn_with_the_numbers(results: Results) -> None:
    changed = Results()
    changed.networks = copy.deepcopy(results.networks)
    for one in changed.networks:
        systems = one["systems"]
        systems["dsnet_rbf"]["r2"] = dict.fromkeys(systems["dsnet_rbf"]["r2"], 0.999)
        for name in ("dsnet_two_lstm", "dsnet_three_lstm"):
            systems[name]["r2"] = dict.fromkeys(systems[name]["r2"], -1.0)
    found = all_claims(changed)
    of_start = next(row for claim, row in found.items() if "initial state" in claim)
    assert of_start.verdict == FAILS
    assert found["More LSTM layers do not improve it"].verdict == HOLDS


RBF = "β at every step is better than β as initial state by radial basis functions"


def test_where_the_grounds_differ_the_verdict_names_both(results: Results) -> None:
    changed = Results()
    papers = copy.deepcopy(results.networks[:1])
    for one in papers:
        one["history_r2"]["validation"] = one["history_r2"]["known_person_known_motion"]
        one["systems"]["dsnet_rbf"]["r2"]["validation"] = 0.999
    changed.papers_networks = papers
    row = all_claims(changed)[RBF]
    assert row.verdict == HOLDS
    assert row.verdict_there == FAILS
    assert row.counted_as == PART
    assert "1.00" in row.on_papers_ground
    assert row.on_papers_ground in page(changed)
    # A system that the study has not trained yet leaves its row as it was.
    del papers[0]["systems"]["dsnet_rbf"]
    changed = Results()
    changed.papers_networks = papers
    found = all_claims(changed)
    assert found[RBF].verdict_there is None
    assert found["Batch normalisation helps convergence"].verdict_there
