"""Betas that measure what is asked, the least unusual, or a refusal that says what would do."""

from __future__ import annotations

import re
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge import DsnetError
from bridge.body import load_body_model
from dsnet.prediction.shapes import (
    MEASURES,
    SHAPES,
    MeasuredBody,
    betas_that_measure,
    find_shape,
    parse_shape,
)
from tests.sources import ROOT

FEMALE = load_body_model("embedded:female")
MEASURED = MeasuredBody(FEMALE)
MEAN = MEASURED(np.zeros(10))
SOME = st.sets(st.sampled_from([*MEASURES]), min_size=1)


def check(betas: np.ndarray, names: set[str]) -> None:
    """What a person measures is found again, by betas that are no farther from the mean."""
    wanted = {name: value for name, value in MEASURED(betas).items() if name in names}
    found = betas_that_measure(MEASURED, wanted)
    again = MEASURED(found)
    assert {name: again[name] for name in wanted} == pytest.approx(wanted, abs=0.1)
    assert np.linalg.norm(found) < np.linalg.norm(betas) + 0.05


@settings(max_examples=3)
@given(st.integers(0, 2**32 - 1), SOME)
def test_measurements_are_found_again(seed, names):
    check(np.random.default_rng(seed).normal(0, 0.6, 10), names)


@pytest.mark.slow
@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), SOME)
def test_measurements_of_many_are_found_again(seed, names):
    check(np.random.default_rng(seed).normal(0, 0.9, 10).clip(-2.5, 2.5), names)


def test_the_mean_person_has_zero_betas():
    np.testing.assert_allclose(betas_that_measure(MEASURED, MEAN), 0.0, atol=1e-3)


def test_a_measurement_counts_more_than_a_name():
    found = MEASURED(find_shape(FEMALE, ["tall", "weight=60"]))
    assert found["height"] == pytest.approx(1.08 * MEAN["height"], abs=0.5)
    assert found["weight"] == pytest.approx(60, abs=0.5)


@pytest.mark.parametrize("name", ["heavy", "pear"])
def test_a_name_gives_its_row_of_the_table(name):
    check_name(FEMALE, (name,))


@pytest.mark.slow
@pytest.mark.parametrize("gender", ["female", "male"])
@pytest.mark.parametrize(
    "names", [*[(name,) for name in SHAPES], *combinations(("tall", "heavy", "pear"), 2)], ids=str
)
def test_every_name_is_within_reach(gender, names):
    check_name(load_body_model(f"embedded:{gender}"), names)


def check_name(body, names) -> None:
    measured = MeasuredBody(body)
    found = measured(find_shape(body, names))
    *before, last = names
    expected = measured(find_shape(body, before))
    for measure, factor in SHAPES[last].items():
        assert found[measure] == pytest.approx(factor * expected[measure], abs=0.5)


@pytest.mark.slow
def test_names_come_in_any_order():
    one, other = (find_shape(FEMALE, names) for names in (["heavy", "short"], ["short", "heavy"]))
    np.testing.assert_array_equal(one, other)


def test_what_the_betas_cannot_give_says_what_they_can():
    with pytest.raises(DsnetError, match=r"shape of height=230\.0.*nearest has height=19\d\.\d "):
        find_shape(FEMALE, ["height=230"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["huge"], "tall, short, heavy"),
        (["size=3"], "each of height, weight, chest, waist, hips"),
        (["height=180", "height=170"], "given before"),
        *(
            ([word], "a number, more than 0 and less than 1000.*in cm")
            for word in ("height=x", "height=", "height=nan", "weight=-5", "weight=1e9", "height=0",
                         "height=1000")
        ),
    ],
)  # fmt: skip
def test_bad_words_are_one_line(words, said):
    with pytest.raises(DsnetError, match=said) as refused:
        find_shape(FEMALE, words)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", [name for name, unit in MEASURES.items() if unit == "cm"])
@pytest.mark.parametrize("metres", [0.5, 0.99, 1.0, 1.829, 2.4])
def test_metres_are_answered_by_the_same_length_in_cm(name, metres):
    with pytest.raises(DsnetError, match=f"{name} in cm") as refused:
        parse_shape([f"{name}={metres}"])
    meant = re.findall(rf"{name}=([\d.]+)\?", refused.value.remedy)
    assert [float(number) for number in meant] == [pytest.approx(100 * metres)]


@pytest.mark.parametrize(("word", "unit"), [("height=6", "cm"), ("weight=0.08", "kg")])
def test_what_no_body_measures_names_the_unit_and_guesses_nothing(word, unit):
    with pytest.raises(DsnetError, match=f"in {unit}") as refused:
        parse_shape([word])
    assert "mean" not in refused.value.remedy


def test_the_page_has_the_table():
    page = (ROOT / "docs" / "animation.md").read_text()
    for name, factors in SHAPES.items():
        cells = " | ".join(f"{factors[m]:.5g}" if m in factors else "" for m in MEASURES)
        assert f"| `{name}` | {cells} |".replace("  ", " ") in page
