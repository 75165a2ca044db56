"""What the report and its page make of `dsnet verify`: a table, the bad news, a heat map."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

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


STAGES: list[str] = ["align", "evaluate"]


@pytest.fixture
def verify(tmp_path: Path) -> Artifact:
    writer = ArtifactWriter(tmp_path / "verify", "verify", data="synthetic")
    writer.file_path("parity.json").write_text(json.dumps(PARITY))
    return writer.finish()


def test_the_largest_differences_of_each_engine(verify):
    found = verification({"verify": verify})
    assert found is not None
    assert (found["rows"], found["held"]) == (5, 3)
    assert found["forward_only"] == ["keras"]
    torch, keras = found["engines"]
    assert (torch["version"], torch["forward"], torch["backward"]) == ("2.0", 1e-15, 1e-13)
    assert (keras["precision"], keras["forward"], keras["backward"]) == ("float32", 0.2, None)


def test_a_run_that_was_not_verified_says_nothing():
    assert verification({}) is None


def test_the_page_shows_the_table_and_what_failed(forged, verify, tmp_path, monkeypatch):
    run = tmp_path / "runs" / "verified"
    shutil.copytree(forged.path, run)
    shutil.copytree(verify.path, run / "verify", dirs_exist_ok=True)
    monkeypatch.setenv("DSNET_RUNS", str(run.parent))
    monkeypatch.setattr(stage_report, "plan_figures", lambda scene: [])
    evaluate_run(Run("verified"))
    stage_report.main(stage_report.ReportConfig(run="verified"))
    page = (run / "report" / "report.md").read_text()
    assert "**3 of 5 rows hold**" in page
    assert "| torch 2.0 | float64 | 1e-15 | 1e-13 |" in page
    assert "| keras 3.0 | float32 | 2e-01 | - |" in page
    assert "- keras: layer lstm" in page


def test_an_older_table_is_left_out_and_the_report_made(
    forged, verify, tmp_path, monkeypatch, capsys
):
    run = tmp_path / "runs" / "older"
    shutil.copytree(forged.path, run)
    writer = ArtifactWriter(run / "verify", "verify", data="synthetic")
    writer.file_path("parity.json").write_text(json.dumps(PARITY))
    writer.finish(upstream={"train": "0" * 64})
    monkeypatch.setenv("DSNET_RUNS", str(run.parent))
    monkeypatch.setattr(stage_report, "plan_figures", lambda scene: [])
    evaluate_run(Run("older"))
    stage_report.main(stage_report.ReportConfig(run="older"))
    assert "verify" in capsys.readouterr().err
    assert "rows hold" not in (run / "report" / "report.md").read_text()
