"""What DSNet learns from each aligner, read from finished runs."""

from __future__ import annotations

import json

import pytest

from benchmarks.alignment.downstream import DownstreamConfig, main
from bridge.errors import DsnetError
from bridge.exchange import Run, write_artifact


def leave_run(name: str, aligner: str, error_mm: float, splits=("validation", "test"), seed=0):
    """A run with the manifests of a finished one."""

    def leave(stage: str, **contents):
        write_artifact(Run(name).path / stage, stage, {}, units={}, data="synthetic", **contents)

    errors = {
        p: {"mean_mm": error_mm * k, "r2": 1 - error_mm * k}
        for k, p in enumerate(("smpl", "dsnet", "dsnet_faithful", "autoencoder"))
    }
    evaluated = {split: {"truth": errors} for split in splits}
    leave("evaluate", splits=evaluated, alignment={"offsets": {"r2": 0.5}})
    leave("align", config={"aligner": aligner}, upstream={"corpus": "c0"})
    leave("train-ae", config={"seed": 0})
    leave("train", config={"seed": seed})


def test_rows_hold_each_runs_own_numbers(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    leave_run("a", "sgd", 0.5)
    leave_run("b", "robust", 0.1)
    results = main(DownstreamConfig(tmp_path / "out", ("a", "b")))
    assert json.loads((tmp_path / "out" / "downstream.json").read_text()) == results
    rows = [
        r for r in (tmp_path / "out" / "downstream.md").read_text().splitlines() if r[:1] == "|"
    ]
    assert (
        rows[2] == "| the paper's SGD | 0.500 | 0.50, 0.50 | 1.00, 0.00 | 0.50, 0.50 | 1.00, 0.00 |"
    )
    assert rows[3].startswith("| robust | 0.500 | 0.10, 0.90 | 0.20, 0.80 |")
    assert "0.00, 1.00" in rows[4]


@pytest.mark.parametrize(
    ("second", "words"),
    [({"seed": 1}, "differ in their settings"), ({"splits": ("test",)}, "without errors against")],
)
def test_runs_that_cannot_be_compared_are_one_line(tmp_path, monkeypatch, second, words):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    leave_run("a", "sgd", 0.5)
    leave_run("b", "robust", 0.1, **second)
    with pytest.raises(DsnetError, match=words):
        main(DownstreamConfig(tmp_path / "out", ("a", "b")))
    assert not (tmp_path / "out").exists()
