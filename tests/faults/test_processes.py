"""Processes that the system ends, and two at once in one place."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from bridge.runs import read_artifact
from bridge.runs.files import work_folder
from tests.faults.conftest import Base
from tests.faults.stages import ROOT, RUN, Stage, check_as_undisturbed, copy_before, make

pytestmark = pytest.mark.faults
FAULT = "processes"
DSNET = [sys.executable, "-c", "from dsnet.cli import main; main()"]
PREDICT = [*DSNET, "predict", "--motion", "sample:walking", "--out"]


def children_of(process: int) -> list[int]:
    found = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="utf-8")
    return [int(child) for child in found.split()]


INFER = f"""
from bridge.processes import exit_with_one_line
from benchmarks.processes import run_dsnet
with exit_with_one_line():
    run_dsnet("infer", "--run", {RUN!r})
"""


def begin_infer(runs: Path) -> subprocess.Popen[str]:
    """A process that waits for a stage's, as the examples have it."""
    return subprocess.Popen(
        [sys.executable, "-c", INFER],
        cwd=ROOT,
        env={**os.environ, "DSNET_RUNS": str(runs)},
        stderr=subprocess.PIPE,
        text=True,
    )


def child_of(process: subprocess.Popen[str]) -> int:
    for _ in range(600):
        if found := children_of(process.pid):
            return found[0]
        time.sleep(0.1)
    raise AssertionError("it began no process")


def gone(process: int) -> bool:
    for _ in range(100):
        if not Path(f"/proc/{process}").exists():
            return True
        time.sleep(0.1)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks for children in /proc")
def test_a_child_that_the_system_ends_is_one_line(
    base: Base, tmp_path: Path, tally: Counter[str]
) -> None:
    copy_before("infer", base.runs, tmp_path)
    process = begin_infer(tmp_path)
    os.kill(child_of(process), signal.SIGKILL)
    said = process.communicate(timeout=600)[1]
    assert process.returncode == 2
    assert said.count("\n") == 1, said
    assert "enough memory" in said
    assert make("infer", tmp_path).status == 0
    check_as_undisturbed("infer", base.runs, tmp_path)
    tally["child killed: one line"] += 1


@pytest.mark.skipif(sys.platform != "linux", reason="looks for children in /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_child_ends_with_its_parent(
    number: int, base: Base, tmp_path: Path, tally: Counter[str]
) -> None:
    copy_before("infer", base.runs, tmp_path)
    process = begin_infer(tmp_path)
    child = child_of(process)
    time.sleep(0.5)
    process.send_signal(number)
    said = process.communicate(timeout=600)[1]
    assert gone(child)
    assert said.count("\n") == (number != signal.SIGKILL), said
    tally["parent ended: child too"] += 1


def test_the_second_process_in_a_stage_is_told(
    base: Base, tmp_path: Path, tally: Counter[str]
) -> None:
    copy_before("train", base.runs, tmp_path)
    first = Stage("train", tmp_path)
    while not (work_folder(tmp_path / RUN / "train") / "fingerprint").exists():
        assert first.process.poll() is None
        time.sleep(0.01)
    first.process.send_signal(signal.SIGSTOP)
    second = make("train", tmp_path)
    first.process.send_signal(signal.SIGCONT)
    assert first.end().status == 0
    assert (second.status, len(second.lines)) == (2, 1), second.said
    assert "which another process is making" in second.said
    check_as_undisturbed("train", base.runs, tmp_path)
    tally["second in a stage: told"] += 1


def test_two_predictions_into_one_folder(tmp_path: Path, tally: Counter[str]) -> None:
    out = tmp_path / "out"
    both = [
        subprocess.Popen([*PREDICT, str(out)], cwd=ROOT, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [process.communicate(timeout=600)[1] for process in both]
    statuses = sorted(process.returncode for process in both)
    assert statuses in ([0, 2], [0, 0]), said
    if statuses == [0, 2]:
        assert sum("one process at a time" in text for text in said) == 1, said
    read_artifact(out, "prediction").verify()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    tally["second into --out: told" if 2 in statuses else "second into --out: afterwards"] += 1
