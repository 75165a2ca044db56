"""What DSNet learns from each aligner or corpus, read from finished runs."""

from __future__ import annotations

import json

import pytest

from benchmarks.alignment.downstream import DownstreamConfig, main
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Run, write_artifact

SEQUENCES = [
    MotionSequence("50004_hips", "50004", "hips", 0, 40, 60.0, "train"),
    MotionSequence("50004_knees", "50004", "knees", 40, 30, 60.0, "train"),
    MotionSequence("50020_hips", "50020", "hips", 70, 20, 60.0, "validation"),
]


def leave_run(
    name: str, aligner: str, error_mm: float, splits=("validation", "test"), seed=0, corpus="c0"
):
    """A run with the manifests of a finished one."""

    def leave(stage: str, **contents):
        write_artifact(Run(name).path / stage, stage, {}, units={}, data="synthetic", **contents)

    errors = {
        p: {"mesh": {"mean_mm": error_mm * k, "r2": 1 - error_mm * k}}
        for k, p in enumerate(("smpl", "first", "second", "person_mean"))
    }
    evaluated = dict.fromkeys(splits, errors)
    labels = {name: name.title() for name in errors}
    leave("evaluate", cells=evaluated, alignment={"offsets": {"r2": 0.5}}, predictors=labels)
    leave(
        "align",
        config={"aligner": aligner},
        upstream={"corpus": corpus},
        sequences=to_manifest(SEQUENCES),
    )
    leave("train-ae", config={"seed": 0})
    leave("train", config={"seed": seed}, predictors={"first": {}, "second": {}})


def test_rows_hold_each_runs_own_numbers(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    leave_run("a", "sgd", 0.5)
    leave_run("b", "robust", 0.1)
    results = main(DownstreamConfig(tmp_path / "out", ("a", "b")))
    assert json.loads((tmp_path / "out" / "by_aligner.json").read_text()) == results
    assert rows(tmp_path / "out" / "by_aligner.md") == [
        "| the paper's SGD | 0.500"
        + 2 * " | 0.50, 0.50 | 1.00, 0.00 | 1.50, -0.50 | 0.00, 1.00"
        + " |",
        "| robust | 0.500" + 2 * " | 0.10, 0.90 | 0.20, 0.80 | 0.30, 0.70 | 0.00, 1.00" + " |",
    ]


def test_corpora_are_named_by_what_is_learned_from_them(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    leave_run("a", "robust", 0.5)
    leave_run("b", "robust", 0.1, corpus="c1")
    main(DownstreamConfig(tmp_path / "out", ("a", "b"), varies="corpus"))
    first, second = rows(tmp_path / "out" / "by_corpus.md")
    assert first.startswith("| 2 motions, 2 sequences, 70 frames | 0.500 | 0.50, 0.50 |")
    assert second.startswith("| 2 motions, 2 sequences, 70 frames | 0.500 | 0.10, 0.90 |")


def rows(page) -> list[str]:
    return [line for line in page.read_text().splitlines() if line[:1] == "|"][2:]


@pytest.mark.parametrize(
    ("second", "words"),
    [
        ({"seed": 1}, "differ in their settings"),
        ({"corpus": "c1"}, "differ in their corpus"),
        ({"splits": ("test",)}, "without errors against"),
    ],
)
def test_runs_that_cannot_be_compared_are_one_line(tmp_path, monkeypatch, second, words):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    leave_run("a", "sgd", 0.5)
    leave_run("b", "robust", 0.1, **second)
    with pytest.raises(DsnetError, match=words):
        main(DownstreamConfig(tmp_path / "out", ("a", "b")))
    assert not (tmp_path / "out").exists()
