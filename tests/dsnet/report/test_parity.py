"""What the report and its page make of `dsnet verify`: a table, the bad news, a heat map."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bridge.runs import Artifact, ArtifactWriter, Run
from dsnet.evaluation.evaluation import evaluate_run
from dsnet.report import stage_report
from dsnet.report.results import verification


def row(check="dsnet-T1", part="layers", engine="torch", dtype="float64", **changes):
    given = {"max_rel": 1e-15, "max_abs": 1e-15, "tolerance": 1e-10, "passed": True}
    return {"check": check, "part": part, "engine": engine, "dtype": dtype, **given, **changes}


PARITY = {
    "passed": False,
    "diagnosis": {"keras: layer lstm": ["dsnet-T1 float32"]},
    "engines": {"torch": {"torch": "2.0"}, "keras": {"keras": "3.0"}},
    "rows": [
        row(),
        row(part="gradients", max_rel=1e-13),
        row(engine="keras", dtype="float32", max_rel=0.2, tolerance=1e-5, passed=False),
        row("ae-batch", "layers", "keras", "float32", max_rel=0.0),
        row("smpl-rest", "all", "keras", "float32", max_rel=None, passed=False),
    ],
}


def verified(run: Run, **finished: Any) -> Artifact:
    writer = ArtifactWriter(run.path / "verify", "verify", data="synthetic")
    writer.file_path("parity.json").write_text(json.dumps(PARITY))
    return writer.finish(**finished)


def test_the_largest_differences_of_each_engine(copied):
    found = verification({"verify": verified(copied("r"))})
    assert found is not None
    assert (found["rows"], found["held"]) == (5, 3)
    assert found["forward_only"] == ["keras"]
    torch, keras = found["engines"]
    assert (torch["version"], torch["forward"], torch["backward"]) == ("2.0", 1e-15, 1e-13)
    assert (keras["precision"], keras["forward"], keras["backward"]) == ("float32", 0.2, None)


def test_a_run_that_was_not_verified_says_nothing():
    assert verification({}) is None


@pytest.mark.usefixtures("no_figures")
def test_the_page_shows_the_table_and_what_failed_but_no_older_table(copied, capsys):
    run, told = copied("r"), []
    evaluate_run(run)
    for finished in ({}, {"upstream": {"train": "0" * 64}}):
        verified(run, **finished)
        stage_report.main(stage_report.ReportConfig(run="r"))
        told.append(((run.path / "report" / "report.md").read_text(), capsys.readouterr().err))
    (page, _), (without, said) = told
    assert "**3 of 5 rows hold**" in page
    assert "| torch 2.0 | float64 | 1e-15 | 1e-13 |" in page
    assert "| keras 3.0 | float32 | 2e-01 | - |" in page
    assert "- keras: layer lstm" in page
    assert "verify" in said
    assert "rows hold" not in without
