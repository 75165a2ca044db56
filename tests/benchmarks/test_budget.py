"""What a profile will take is what a run took, times what its stages are asked to do more."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.budget import BudgetConfig, Work, expected_s, main, table
from tests.sources import ROOT

DONE = Work(
    aligned=100,
    sequences=10,
    subjects=2,
    tested=60,
    align_steps=1000,
    autoencoder_steps=50,
    rounds=8,
    epochs=100,
)
NAMES = ("corpus", "truth", "align", "align_robust", "train-ae", "encode", "train", "infer",
         "decode", "train_plus", "infer_plus", "evaluate")  # fmt: skip
STAGES = {name: {"wall_time_s": 10.0, "measured": {}} for name in NAMES}
STAGES["train-ae"]["measured"] = {"autoencoder_training_s": 6.0}


def test_the_same_work_takes_the_same_time():
    expected = expected_s(STAGES, DONE, DONE, None)
    assert expected == pytest.approx(dict.fromkeys(NAMES, 10.0))
    assert "| `train` | 1 | 0.2 |" in table(expected, 1)
    assert "| `train` | 3 | 0.5 |" in table(expected, 3)
    assert table(expected, 3).endswith("| all | | 4 |\n")


@pytest.mark.parametrize(
    ("change", "times"),
    [
        ({"align_steps": 3000}, {"align": 3.0}),
        ({"epochs": 250}, {"train": 2.5}),
        ({"rounds": 16}, {"train_plus": 2.0}),
        ({"autoencoder_steps": 100}, {"train-ae": 1.6}),
        ({"tested": 160}, {"truth": 1.625, "infer": 1.625, "decode": 190 / 90,
                           "infer_plus": 190 / 90, "evaluate": 190 / 90}),
    ],
)  # fmt: skip
def test_more_of_one_thing_takes_more_of_what_does_it(change, times):
    expected = expected_s(STAGES, DONE, replace(DONE, **change), None)
    assert expected == pytest.approx({name: 10.0 * times.get(name, 1.0) for name in NAMES})


def test_a_steps_time_can_be_given():
    assert expected_s(STAGES, DONE, DONE, 0.2)["train-ae"] == pytest.approx(50 * 0.2 + 4.0)


def test_the_paper_fits_into_three_hours_with_a_fifth_to_spare(capsys):
    """By the stage times of the committed `demo`; the page has the number."""
    main(BudgetConfig(results=ROOT / "docs" / "results" / "demo" / "results.json", step_s=0.4))
    minutes = int(capsys.readouterr().out.split()[-2])
    assert minutes <= 180 / 1.2
    page = (ROOT / "docs" / "paper.md").read_text()
    assert f", {minutes} from [the last one's]" in page
