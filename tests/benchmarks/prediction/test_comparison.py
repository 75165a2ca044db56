"""The comparison's page and its refusals: from scores that lie there, without any training."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.prediction import comparison, corpora
from benchmarks.prediction.comparison_clips import draw_clips
from benchmarks.prediction.comparison_page import systems_of
from benchmarks.prediction.comparison_scores import joined, refuse_mixture
from bridge.errors import DsnetError
from bridge.motion.splits import CELLS
from bridge.runs import Run
from dsnet.evaluation.evaluation import evaluate_run
from tests.dsnet.report.conftest import forge_run

DOCS = Path(__file__).parents[3] / "docs" / "results" / "comparison"
RIVAL = {
    "label": "Rival",
    "code": "pca",
    "parameters": 1234,
    "lr": 0.001,
    "departures": ["a choice"],
}


def score(seed: int, plus: float, rival: float, corpus: str = "own") -> dict:
    r2 = {"dsnet_plus": plus, "rival": rival, "person_mean": 0.1, "smpl": 0.0}
    errors = {name: {"r2": value, "mesh_mean_mm": 1.5} for name, value in r2.items()}
    # Of 2 mm the rival misses 1 mm in the invented motion, and 3 of 4 mm in the real one.
    sequences = [
        _sequence("99001_dancing", 100, missed_mm=1.0, whole_mm=2.0),
        _sequence("99001_amass_x", 300, missed_mm=3.0, whole_mm=4.0),
    ]
    return {
        "corpus": corpus,
        "seed": seed,
        "profile": "demo",
        "epochs": 500,
        "test_bed": {"tissue": "own", "form": "clean", "gravity": True, "gender": "female"},
        "labels": {"dsnet_plus": "DSNet+", "rival": "Rival", "smpl": "SMPL alone",
                   "person_mean": "mean"},
        "cells": dict.fromkeys(CELLS, errors),
        "sequences": sequences,
        "systems": {"rival": RIVAL},
        "over_time": {"sequence": "99001_dancing",
                      "mm": {"true": [1.0, 2.0], "dsnet_plus": [1.0, 2.0], "rival": [0.0, 1.0]}},
    }  # fmt: skip


def _sequence(name: str, frames: int, missed_mm: float, whole_mm: float) -> dict:
    missed = dict.fromkeys(("dsnet_plus", "rival", "person_mean"), missed_mm)
    errors = {n: {"rms_mm": rms} for n, rms in (missed | {"smpl": whole_mm}).items()}
    return {"name": name, "cell": "new_person_unseen_motion", "frames": frames, "errors": errors}


@pytest.fixture
def no_training(monkeypatch, tmp_path):
    """Whatever would start a stage is a mistake, and there is no run to draw bodies of."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))

    def refuse(*arguments: str) -> None:
        raise AssertionError(arguments)

    monkeypatch.setattr(corpora, "dsnet", refuse)
    monkeypatch.setattr(comparison, "registered", lambda: ("rival",))


def write(folder: Path, *scores: dict) -> None:
    for one in scores:
        (folder / f"{one['corpus']}-{one['seed']}.json").write_text(json.dumps(one))


def config(folder: Path, **options) -> comparison.ComparisonConfig:
    return comparison.ComparisonConfig(out=folder, seeds=(0, 1), **options)


def test_finished_scores_become_a_page_and_figures(tmp_path, no_training):
    write(tmp_path, score(0, 0.9, 0.5), score(1, 0.8, 0.7))
    comparison.main(config(tmp_path))
    text = comparison.page_path(tmp_path).read_text()
    (row,) = (line for line in text.splitlines() if line.startswith("| Rival"))
    assert row.startswith("| Rival | 1,234 | 0.600 ± 0.141 | 1.50 ± 0.00 |")
    assert row.endswith(f"|  | {1 - 1 / 4:.3f} ± 0.000 |")
    order = [line.split(" | ")[0] for line in text.splitlines() if line.startswith("| ")]
    assert order == ["| system", "| DSNet+", "| Rival", "| mean", "| SMPL alone"]
    assert "- **Rival** (`rival`): a choice." in text
    assert "training seeds 0, 1" in text
    for name in ("cost.png", "cells.png", "over_time.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_clips_are_drawn_of_an_evaluated_run(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    forge_run(tmp_path / "forged")
    run = Run("forged")
    evaluate_run(run)
    tested = run.artifact("evaluate").manifest["per_sequence"][-1]["name"]
    draw_clips(tmp_path / "clips.png", run, tested)
    assert (tmp_path / "clips.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("plus", "rival", "said"),
    [
        ((0.90, 0.91), (0.5, 0.6), "DSNet+ has the least error in every cell, with its worst seed"),
        ((0.80, 0.90), (0.7, 0.84), "but not for: known person, known motion; known"),
        ((0.5, 0.6), (0.90, 0.91), "but not for: known person, known motion; known"),
    ],
)
def test_the_verdict_is_the_numbers(tmp_path, no_training, plus, rival, said):
    write(tmp_path, *(score(seed, plus[seed], rival[seed]) for seed in (0, 1)))
    comparison.main(config(tmp_path))
    assert said in comparison.page_path(tmp_path).read_text()


def test_a_system_that_one_seed_lacks_has_no_row():
    second = score(1, 0.9, 0.5)
    for errors in second["cells"].values():
        errors.pop("rival", None)
    assert systems_of([score(0, 0.9, 0.5), second]) == ["dsnet_plus", "person_mean", "smpl"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("epochs", 20),
        ("profile", "smoke"),
        ("test_bed", {"tissue": "second"}),
        ("sequences", [_sequence("99001_dancing", 90, 1.0, 2.0)]),
    ],
)
def test_scores_that_do_not_belong_together_are_refused(tmp_path, no_training, key, value):
    write(tmp_path, score(0, 0.9, 0.5), score(1, 0.9, 0.5) | {key: value})
    with pytest.raises(DsnetError, match=rf"own-1\.json with other {key} than own-0\.json"):
        comparison.main(config(tmp_path))


def test_unknown_names_are_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(comparison, "registered", lambda: ("dsnet_lstm",))
    with pytest.raises(DsnetError, match="corpora fourth; expected some of own"):
        comparison.main(config(tmp_path, corpora=("fourth",)))
    with pytest.raises(DsnetError, match=r"systems dsnet_four_lstm; expected some of dsnet_"):
        comparison.main(config(tmp_path, systems=("dsnet_four_lstm",)))


def test_a_score_that_is_missing_is_made(tmp_path, no_training):
    with pytest.raises(AssertionError, match="corpus"):
        comparison.main(config(tmp_path))


def test_a_system_that_a_score_lacks_is_made(tmp_path, no_training, monkeypatch):
    write(tmp_path, score(0, 0.9, 0.5), score(1, 0.8, 0.7))
    monkeypatch.setattr(comparison, "registered", lambda: ("rival", "newcomer"))
    with pytest.raises(AssertionError, match="corpus"):
        comparison.main(config(tmp_path))


def of_newcomer() -> dict:
    """What a run gives in which only the newcomer was trained."""
    return json.loads(json.dumps(score(0, 0.1, 0.6)).replace("rival", "newcomer"))


def test_a_new_system_joins_the_others():
    kept = score(0, 0.9, 0.5)
    both = joined(kept, of_newcomer(), ["newcomer"], "own-0.json")
    assert set(both["systems"]) == {"rival", "newcomer"}
    assert set(both["labels"]) == {*kept["labels"], "newcomer"}
    for errors in both["cells"].values():
        r2 = {name: one["r2"] for name, one in errors.items()}
        assert r2 == {"dsnet_plus": 0.9, "rival": 0.5, "newcomer": 0.6,
                      "person_mean": 0.1, "smpl": 0.0}  # fmt: skip
    assert all("newcomer" in one["errors"] for one in both["sequences"])
    assert both["over_time"]["mm"]["newcomer"] == [0.0, 1.0]


def test_a_system_of_other_data_does_not_join():
    other = of_newcomer()
    other["sequences"][1]["errors"]["smpl"]["rms_mm"] += 0.01
    with pytest.raises(DsnetError, match=r"other offsets of 99001_amass_x than in own-0\.json"):
        joined(score(0, 0.9, 0.5), other, ["newcomer"], "own-0.json")
    with pytest.raises(DsnetError, match=r"other epochs than in own-0\.json"):
        joined(
            score(0, 0.9, 0.5), of_newcomer() | {"epochs": 20}, ["newcomer"],
            "own-0.json",
        )  # fmt: skip


def test_the_committed_page_is_made_of_the_committed_scores():
    refuse_mixture(DOCS)
    assert comparison.page_path(DOCS).read_text() == comparison.markdown(DOCS)
