"""Runs with other predictors than the usual ones go through every later stage."""

from __future__ import annotations

import json
import os
import shutil

import pytest

from bridge.runs import read_artifact
from tests.forged.plugin import use_plugin
from tests.pages import python_blocks

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
