"""Tables of the test bed and of the ablation: from scores that lie there, without any training."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.prediction import ablation, corpora, test_bed
from bridge.errors import DsnetError
from bridge.motion.splits import CELLS


def score(corpus: str, seed: int, r2: float) -> dict:
    errors = {
        "offsets": {"r2": r2},
        "velocity": {"r2": r2 - 0.1},
        "mesh": {"mean_mm": 1.0, "p95_mm": 2.5},
    }
    return {
        "corpus": corpus,
        "seed": seed,
        "cells": {"new_person_unseen_motion": {"dsnet_plus": errors}},
        "labels": {"dsnet_plus": "DSNet+"},
        "sequences": [
            _sequence("50004_amass_x", errors, 300, 4.0, 5.0),
            _sequence("50004_dancing", errors, 100, 1.0, 2.0),
            _sequence("50004_kicking", errors, 200, 1.0, 4.0),
        ],
    }


def _sequence(name: str, errors: dict, frames: int, rms_mm: float, whole_mm: float) -> dict:
    """Of the cell, with the errors' root mean square and that of what there is to predict."""
    own = {**errors, "offsets": {**errors["offsets"], "rms_mm": rms_mm}}
    both = {"dsnet_plus": own, "smpl": {"offsets": {"rms_mm": whole_mm}}}
    return {"name": name, "cell": "new_person_unseen_motion", "frames": frames, "errors": both}


@pytest.fixture
def no_training(monkeypatch):
    """Whatever would start a stage is a mistake."""

    def refuse(*arguments: str) -> None:
        raise AssertionError(arguments)

    monkeypatch.setattr(corpora, "dsnet", refuse)


def test_finished_scores_are_tabulated_with_their_spread(tmp_path, no_training):
    for seed, r2 in enumerate((0.9, 0.8)):
        (tmp_path / f"second-{seed}.json").write_text(json.dumps(score("second", seed, r2)))
    config = test_bed.TestBedConfig(out=tmp_path, corpora=("second",), seeds=(0, 1))
    test_bed.main(config)
    rows = [
        line for line in (tmp_path / "test_bed.md").read_text().splitlines() if "DSNet+" in line
    ]
    assert rows[0] == (
        "| second | new person, unseen motion | DSNet+ | 2 | 0.850 ± 0.071 |  | 0.750 ± 0.071"
        f" | 1.00 ± 0.00 | 2.50 ± 0.00 | {1 - 300 / 3600:.3f} ± 0.000 |"
    )
    assert rows[1].startswith("| second | real motion `50004_amass_x` | DSNet+ | 2 | 0.850 ± 0.071")
    assert len(rows) == 2


def test_the_committed_page_is_made_of_the_committed_scores():
    folder = Path(__file__).parents[3] / "docs" / "results" / "prediction"
    assert (folder / "test_bed.md").read_text() == test_bed.markdown(folder)


def test_a_score_that_is_missing_is_made(tmp_path, no_training):
    with pytest.raises(AssertionError, match="corpus"):
        test_bed.main(test_bed.TestBedConfig(out=tmp_path, corpora=("second",), seeds=(0,)))


def test_an_unknown_corpus_is_one_line(tmp_path):
    with pytest.raises(DsnetError, match="fourth"):
        test_bed.main(test_bed.TestBedConfig(out=tmp_path, corpora=("fourth",)))
    with pytest.raises(DsnetError, match="fourth"):
        ablation.main(ablation.AblationConfig(out=tmp_path, corpus="fourth"))


def test_finished_rows_of_the_ablation_are_kept(tmp_path, no_training):
    for place, (name, options) in enumerate(ablation.VARIANTS.items()):
        r2 = dict.fromkeys(CELLS, 0.5 + place / 100)
        row = {"name": name, "options": list(options), "r2": r2}
        (tmp_path / f"row-{place}.json").write_text(json.dumps(row))
    ablation.main(ablation.AblationConfig(out=tmp_path))
    table = (tmp_path / "ablation.md").read_text()
    assert "| all of it |  | 0.500 | 0.500 | 0.500 | 0.500 |" in table
    assert "| no gravity among the loads | `--no-gravity` | 0.510 |" in table
