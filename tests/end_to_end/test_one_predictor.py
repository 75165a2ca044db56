"""A run that trains one predictor only goes through every later stage."""

from __future__ import annotations

import json
import shutil

import pytest

LATER = (
    ["train", "--predictors", "dsnet_standardised"],
    ["infer"],
    ["decode"],
    ["evaluate"],
    ["report"],
)


@pytest.mark.slow
def test_one_predictor_alone_reaches_the_report(smoke_runs, execute, tmp_path) -> None:
    shutil.copytree(smoke_runs / "smoke", tmp_path / "smoke")
    for command in LATER:
        done = execute([".venv/bin/dsnet", *command, "--profile", "smoke"], tmp_path)
        assert done.returncode == 0, done.stderr
    trained = json.loads((tmp_path / "smoke" / "train" / "manifest.json").read_text())
    assert list(trained["predictors"]) == ["dsnet_standardised"]
    assert "dsnet_faithful" not in (tmp_path / "smoke" / "report" / "results.json").read_text()
