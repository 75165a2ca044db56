"""The verdict beside each of the paper's numbers."""

from __future__ import annotations

from typing import Any

import pytest

from bridge.paper import NUMBERS, PaperNumber
from dsnet.report.paper_table import Measured, compare, verdict


def stated(value, unit=""):
    return PaperNumber("key", "5", "something", value, unit)


@pytest.mark.parametrize(
    ("paper", "ours", "expected"),
    [
        (stated(100), Measured(100, "never shown"), "same"),
        (stated(60), Measured(60.0), "same"),
        (stated((2, 15)), Measured((2, 15)), "same"),
        (stated(100), Measured(99, "too small"), "differs: too small"),
        (stated(100), Measured(99), "differs: not explained"),
        (stated(100), Measured(None), "differs: not part of this run"),
        (stated(None), Measured(7), "paper does not say"),
        (stated((1, 2), "unit not stated"), Measured((1, 2), "no unit"), "differs: no unit"),
    ],
)
def test_verdict(paper, ours, expected):
    assert verdict(paper, ours) == expected


def test_a_number_without_an_entry_is_a_mistake():
    with pytest.raises(KeyError):
        compare({})


def test_keys_are_unique_and_the_papers_arithmetic_holds():
    keys = [record.key for record in NUMBERS]
    assert len(set(keys)) == len(keys)
    values: dict[str, Any] = {record.key: record.value for record in NUMBERS}
    share = 100 * values["ae_parameters"] / values["casas_otaduy_parameters"]
    assert round(share, 1) == values["parameter_share"]
    assert values["joints"] * 3 + 3 == values["theta"]
    assert values["theta"] + values["betas"] == values["dsnet_input"]
    assert 3 * values["vertices"] == values["mesh_size"]
    total = values["ae_train_frames"] + values["ae_validation_frames"]
    assert total * 7 // 10 == values["ae_train_frames"]
    assert values["vertices"] == 6890
