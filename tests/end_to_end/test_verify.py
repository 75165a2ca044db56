"""`dsnet verify` on a run's own networks, and the report that shows it."""

from __future__ import annotations

import shutil

import pytest


@pytest.mark.slow
def test_a_trained_run_verifies_and_its_report_says_so(smoke_runs, tmp_path, execute):
    shutil.copytree(smoke_runs / "smoke", tmp_path / "smoke")
    verified = execute([".venv/bin/dsnet", "verify", "--profile", "smoke"], tmp_path)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    for check in ("dsnet-standardised", "dsnet-faithful-stream", "ae-trained-gradients"):
        assert f"\n{check} " in verified.stdout
    reported = execute([".venv/bin/dsnet", "report", "--profile", "smoke"], tmp_path)
    assert reported.returncode == 0, reported.stderr
    page = (tmp_path / "smoke" / "report" / "report.md").read_text()
    assert "rows hold**" in page
