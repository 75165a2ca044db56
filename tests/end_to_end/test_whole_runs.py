"""Whole runs: of two seeds, of one or an added predictor, and verified."""

from __future__ import annotations

import json
import os
import shutil

import pytest

from bridge.runs import read_artifact
from dsnet.verify.checks import random_checks
from dsnet.verify.engines import REFERENCE
from tests.forged.plugin import use_plugin
from tests.pages import python_blocks
from tests.smoke_run import link_run


@pytest.mark.slow
def test_two_seeds_stand_in_one_report(smoke_runs, execute, tmp_path):
    runs = link_run(smoke_runs, tmp_path)
    done = execute(["./reproduce.sh", "--profile", "smoke", "--seeds", "2"], runs)
    assert done.returncode == 0, done.stderr
    made = [runs / run / "train_plus" for run in ("smoke", "smoke-seed1")]
    first, second = (read_artifact(path).content_sha256 for path in made)
    assert first != second
    seeds = json.loads((runs / "smoke" / "report" / "results.json").read_text())["seeds"]
    assert seeds["seeds"] == [0, 1]
    for name in ("dsnet_standardised", "dsnet_faithful", "dsnet_plus"):
        assert seeds["cells"]["validation"][name]["offsets"]["r2"]["sd"] > 0
    page = (runs / "smoke" / "report" / "report.md").read_text()
    assert "trainings from seeds 0, 1 on one alignment" in page


ALONE = ("train", "--predictors", "dsnet_standardised")
LATER = ("infer", "decode", "evaluate", "report")


@pytest.mark.slow
def test_one_predictor_alone_reaches_the_report(smoke_runs, execute, tmp_path):
    later = shutil.ignore_patterns("train", "train_plus", "infer*", "decode", "evaluate", "report")
    shutil.copytree(smoke_runs / "smoke", tmp_path / "smoke", ignore=later)
    for command in (ALONE, *([name] for name in LATER)):
        done = execute([".venv/bin/dsnet", *command, "--profile", "smoke"], tmp_path)
        assert done.returncode == 0, done.stderr
    trained = json.loads((tmp_path / "smoke" / "train" / "manifest.json").read_text())
    assert list(trained["predictors"]) == ["dsnet_standardised"]
    assert "dsnet_faithful" not in (tmp_path / "smoke" / "report" / "results.json").read_text()


@pytest.mark.slow
def test_an_added_network_reaches_the_report_by_one_command(
    smoke_runs, execute, tmp_path, monkeypatch
):
    shutil.copytree(smoke_runs / "smoke", tmp_path / "added")
    (source,) = [block for block in python_blocks("CONTRIBUTING.md") if "GRU" in block]
    use_plugin(tmp_path, monkeypatch, source)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    before = read_artifact(tmp_path / "added" / "train")
    train = ["train", "--run", "added", "--epochs", "2", "--predictors", "gru"]
    for command in (train, ["report", "--update", "--profile", "smoke", "--run", "added"]):
        done = execute([".venv/bin/dsnet", *command], tmp_path)
        assert done.returncode == 0, done.stderr
    trained = read_artifact(tmp_path / "added" / "train")
    assert list(trained.manifest["predictors"]) == [*before.manifest["predictors"], "gru"]
    for weights, digest in before.manifest["files"].items():
        assert trained.manifest["files"][weights] == digest
    results = json.loads((tmp_path / "added" / "report" / "results.json").read_text())
    assert (
        "`gru`: trained for 2 epochs" in (tmp_path / "added" / "report" / "report.md").read_text()
    )
    measured = results["cells"]["validation"]
    assert {"gru", "dsnet_faithful", "dsnet_plus"} <= set(measured)


@pytest.mark.slow
def test_a_trained_run_verifies_and_its_report_says_so(smoke_runs, tmp_path, execute):
    shutil.copytree(smoke_runs / "smoke", tmp_path / "smoke")
    verified = execute([".venv/bin/dsnet", "verify", "--profile", "smoke"], tmp_path)
    assert (verified.returncode, verified.stderr) == (0, ""), verified.stdout
    for check in ("dsnet-standardised", "dsnet-faithful-stream", "ae-trained-gradients"):
        assert f"\n{check} " in verified.stdout
    parity = json.loads((tmp_path / "smoke" / "verify" / "parity.json").read_text())
    shown = [*parity["rows"], *parity["skipped"]]  # on a GPU, where there is none
    rows = {(row["check"], row["engine"], row["dtype"]) for row in shown}
    assert rows >= {
        (check.name, engine, dtype)
        for check in random_checks(0, "embedded:female")
        for engine in check.engines
        if engine != REFERENCE
        for dtype in check.precisions(engine)
    }
    reported = execute([".venv/bin/dsnet", "report", "--profile", "smoke"], tmp_path)
    assert reported.returncode == 0, reported.stderr
    page = (tmp_path / "smoke" / "report" / "report.md").read_text()
    assert "rows hold**" in page
