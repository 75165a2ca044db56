"""Two seeds by one command: two trainings on one alignment, with their spread in the report."""

from __future__ import annotations

import json

import pytest

from bridge.runs import read_artifact
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
