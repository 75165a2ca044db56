"""Two seeds by one command: killed under way and called again, it ends with the same bytes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from bridge.runs import read_artifact
from tests.sources import ROOT

COMMAND = ["./reproduce.sh", "--profile", "smoke", "--seeds", "2"]
RUNS = "smoke", "smoke-seed1"
MADE = ("train", "train_plus", "infer", "infer_plus", "decode", "evaluate")


def digests(runs: Path) -> dict[str, str]:
    return {
        f"{run}/{stage}": read_artifact(runs / run / stage).content_sha256
        for run in RUNS
        for stage in MADE
    }


def kill_when_there_is(path: Path, runs: Path) -> None:
    """Begin the command; end it and all that it has begun, by SIGKILL, a moment after `path`."""
    process = subprocess.Popen(
        COMMAND,
        cwd=ROOT,
        env={**os.environ, "DSNET_RUNS": str(runs)},
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )
    while not path.exists() and process.poll() is None:
        time.sleep(0.05)
    time.sleep(1.0)
    assert process.poll() is None
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.slow
def test_seeds_killed_and_gone_on_with_are_the_same(smoke_runs, execute, tmp_path):
    shutil.copytree(
        smoke_runs / "smoke",
        tmp_path / "smoke",
        copy_function=os.link,
        ignore=shutil.ignore_patterns("report"),
    )
    assert execute(COMMAND, smoke_runs).returncode == 0
    for begun in ("smoke-seed1/.train_plus.partial", "smoke-seed1/.decode.partial"):
        kill_when_there_is(tmp_path / begun, tmp_path)
    done = execute(COMMAND, tmp_path)
    assert done.returncode == 0, done.stderr
    found = digests(tmp_path)
    assert found == digests(smoke_runs)
    assert len({found[f"{run}/train_plus"] for run in RUNS}) == 2
    reports = [
        json.loads((runs / "smoke" / "report" / "results.json").read_text())
        for runs in (smoke_runs, tmp_path)
    ]
    assert reports[0]["seeds"] == reports[1]["seeds"]
    assert reports[0]["seeds"]["seeds"] == [0, 1]
    cells = reports[0]["seeds"]["cells"]
    for name in ("dsnet_standardised", "dsnet_faithful", "dsnet_plus"):
        assert cells["validation"][name]["offsets"]["r2"]["sd"] > 0
    page = (smoke_runs / "smoke" / "report" / "report.md").read_text()
    assert "trainings from seeds 0, 1 on one alignment" in page
