"""The table of claims is made of the results files, and a verdict follows its numbers."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from benchmarks.claims.__main__ import PAGE, page
from benchmarks.claims.alignment import _gains
from benchmarks.claims.claims import claims
from benchmarks.claims.of_training import of_range
from benchmarks.claims.references import InComponents, InOffsets, r2
from benchmarks.claims.results import Results
from benchmarks.claims.row import FAILS, HOLDS, PART, Claim
from bridge.motion import MotionSequence


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


def test_single_facts_are_judged_by_their_numbers() -> None:
    layers = {"batch_norm": {"outside": 0.0, "largest": 0.9}}
    networks = {"dsnet_faithful": {"train": layers, "validation": layers}}
    assert of_range({"networks": networks}).verdict == HOLDS
    layers["batch_norm"]["outside"] = 0.6
    assert of_range({"networks": networks}).verdict == FAILS


def test_an_error_of_coefficients_is_that_of_the_offsets_they_stand_for() -> None:
    rng = np.random.default_rng(0)
    offsets, mean = rng.normal(size=(5, 30)), rng.normal(size=30)
    directions = np.linalg.qr(rng.normal(size=(30, 4)))[0].T
    codes, predicted = (offsets - mean) @ directions.T, rng.normal(size=(5, 4))
    left_out = np.square(offsets - mean).sum(axis=1) - np.square(codes).sum(axis=1)
    reference = InComponents(codes, left_out, np.square(offsets).sum(axis=1))
    restored = mean + predicted @ directions
    expected = np.square(restored - offsets).sum(axis=1)
    np.testing.assert_allclose(reference.errors(predicted), expected)
    assert r2(expected, expected) == 0.0
    assert r2(0 * expected, reference.squares) == 1.0


class Held:
    """Arrays of one sequence."""

    def __init__(self, offsets_m: np.ndarray) -> None:
        self.offsets_m = offsets_m
        self.sequences = {"one": MotionSequence("one", "a", "b", 0, len(offsets_m), 60.0)}

    def frames(self, array: str, name: str, frames: slice) -> np.ndarray:
        return self.offsets_m[frames]


def test_codes_are_held_against_the_offsets_that_they_decode_to() -> None:
    rng = np.random.default_rng(0)
    true_m, kernel = rng.normal(size=(150, 4, 3)), rng.normal(size=(5, 12))
    codes, others = rng.normal(size=(2, 150, 5))

    def decode(codes: np.ndarray) -> np.ndarray:
        return (codes @ kernel).reshape(len(codes), 4, 3)

    reference = InOffsets(Held(true_m), "one", decode)  # pyright: ignore
    expected = np.square(decode(codes) - true_m).sum(axis=(1, 2))
    np.testing.assert_allclose(reference.errors(codes), expected)
    np.testing.assert_allclose(reference.errors(codes[70:], 70), expected[70:])
    np.testing.assert_allclose(reference.squares, np.square(true_m).sum(axis=(1, 2)))
    apart = np.square(decode(codes) - decode(others)).sum(), np.square(decode(codes)).sum()
    np.testing.assert_allclose(reference.moved(codes, others), apart)


def test_the_best_gain_undoes_what_was_taken_in_proportion() -> None:
    true_m = np.random.default_rng(0).normal(size=(70, 4, 3))
    found = _gains(Held(true_m / 2), "offsets", ["one"], Held(true_m))  # pyright: ignore
    assert found["best_gain"] == 2.0
    assert found["best_r2"] == 1.0
    assert found["r2"]["1"] == pytest.approx(0.75)
