"""One real run of the `smoke` profile by the README's command, for every test in this folder."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


Execute = Callable[[list[str], Path], "subprocess.CompletedProcess[str]"]


def _execute(command: list[str], runs: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "DSNET_RUNS": str(runs)}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture
def execute() -> Execute:
    """Run a command at the repository's root with a given folder in place of `runs/`."""
    return _execute


@pytest.fixture(scope="session")
def smoke_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that holds the finished run `smoke`."""
    runs = tmp_path_factory.mktemp("runs")
    done = _execute(["./reproduce.sh", "--profile", "smoke"], runs)
    assert done.returncode == 0, done.stdout + done.stderr
    return runs
