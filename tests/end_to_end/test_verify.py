"""`dsnet verify` on a run's own networks, and the report that shows it."""

from __future__ import annotations

import json
import shutil

import pytest

from dsnet.verify.checks import random_checks
from dsnet.verify.engines import REFERENCE


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
