"""One finished run of the profile `smoke`, made once for all tests that need one.

DSNET_TEST_RUNS=FOLDER python -m tests.smoke_run    beside linters, say
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from filelock import FileLock

from tests.sources import ROOT

GIVEN = "DSNET_TEST_RUNS"
"""Names the folder that the run is in, or is made in if it is not there yet."""

ARTIFACTS = (
    "corpus", "truth", "align", "align_robust", "train-ae", "encode", "train", "train_plus",
    "infer", "infer_plus", "decode", "evaluate", "report",
)  # fmt: skip
"""Folders of a finished run, in the order in which they are made."""
ONE_CORE = {"OMP_NUM_THREADS": "1"}


def execute(command: list[str], runs: Path) -> subprocess.CompletedProcess[str]:
    """Run a command at the repository's root with a given folder in place of `runs/`.

    On one core, as PyTorch splits sums by the number of threads: runs are compared bit by bit.
    """
    environment = {**os.environ, "DSNET_RUNS": str(runs), **ONE_CORE}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )


def finished_runs(common: Path) -> Path:
    """The folder named by the environment, or one in `common`, which all processes share."""
    runs = Path(os.environ.get(GIVEN, common / "runs"))
    with FileLock(runs.with_suffix(".lock")):
        if not (runs / "smoke" / "report" / "manifest.json").exists():
            done = execute(["./reproduce.sh", "--profile", "smoke"], runs)
            assert done.returncode == 0, done.stdout + done.stderr
    return runs


def link_run(runs: Path, to: Path) -> Path:
    """A folder with that run, whose files are the same on disk: nothing writes into them."""
    shutil.copytree(runs / "smoke", to / "smoke", copy_function=_link)
    return to


def _link(source: str, target: str) -> str:
    try:
        os.link(source, target)
    except OSError:  # on another disk
        return shutil.copy2(source, target)
    return target


if __name__ == "__main__":
    finished_runs(Path(os.environ[GIVEN]))
