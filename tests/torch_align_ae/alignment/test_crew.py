"""Processes that share work out: same results, and none that outlives its use."""

from __future__ import annotations

import multiprocessing
import operator
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from torch_align_ae.alignment.crew import crew

HANDS = 2


def test_results_come_in_order_whoever_works():
    tools, items = torch.arange(6.0), [slice(0, 2), slice(4, 6), slice(1, 4)]
    found = []
    for hands in (1, HANDS):
        with crew(tools, hands) as workers:
            found.append([part.tolist() for part in workers.map(operator.getitem, items)])
    assert found == [[[0.0, 1.0], [4.0, 5.0], [1.0, 2.0, 3.0]]] * 2
    assert not multiprocessing.active_children()


def sleep(_: object, seconds: float) -> None:
    time.sleep(seconds)


def be_interrupted() -> None:
    with crew(None, HANDS) as workers:
        results = workers.map(sleep, [0.0, 600.0, 600.0])
        next(results)
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_does_not_wait_for_work():
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        be_interrupted()
    assert not multiprocessing.active_children()
    assert time.monotonic() - began < 300


def test_what_a_worker_raises_is_raised():
    with pytest.raises(ZeroDivisionError), crew(1, HANDS) as workers:
        list(workers.map(operator.truediv, [0]))


KILLED = """
import multiprocessing, os, signal
from torch_align_ae.alignment.crew import crew
from tests.torch_align_ae.alignment.test_crew import sleep

if __name__ == "__main__":
    with crew(None, 2) as workers:
        next(workers.map(sleep, [0.0, 600.0, 600.0]))
        print(*(process.pid for process in multiprocessing.active_children()), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_processes_end_with_a_killed_parent(tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(KILLED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
        stdout=subprocess.PIPE,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL
    orphans = [int(pid) for pid in done.stdout.split()]
    assert len(orphans) == HANDS
    deadline = time.monotonic() + 60
    while any(map(alive, orphans)):
        assert time.monotonic() < deadline, "a process outlived its parent"
        time.sleep(0.1)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat", encoding="utf-8") as stat:
        return stat.read().rpartition(")")[2].split()[0] != "Z"
