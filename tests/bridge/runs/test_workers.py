"""Workers of every kind: same results, refusals in their own words, no process that stays."""

from __future__ import annotations

import multiprocessing
import operator
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bridge.errors import DsnetError, InterruptedWorkError
from bridge.runs import Run
from bridge.runs.workers import on_any_node, use_engine, worker_pool
from dsnet.cli import main

N_WORKERS = 2
KINDS = ("serial", "threads", "processes")


@dataclass(frozen=True)
class Config:
    run: str = "x"


def take(array: np.ndarray, rows: slice) -> np.ndarray:
    return array[rows]


@pytest.mark.parametrize("kind", KINDS)
def test_results_come_in_order_whoever_works(kind):
    tools, items = np.arange(6.0), [slice(0, 2), slice(4, 6), slice(1, 4)] * 4
    with worker_pool(kind, tools, N_WORKERS) as pool:
        found = [part.tolist() for part in pool.map(take, items)]
    assert found == [[0.0, 1.0], [4.0, 5.0], [1.0, 2.0, 3.0]] * 4
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(("kind", "most"), [("serial", 1), ("threads", 5), ("processes", 5)])
def test_only_a_few_more_are_begun_than_are_taken(kind, most):
    begun = []
    items = (begun.append(item) or item for item in range(20))
    with worker_pool(kind, 1, N_WORKERS) as pool:
        results = pool.map(operator.add, items)
        for taken in range(20):
            assert next(results) == taken + 1
            assert len(begun) <= taken + most


def cores_of_products(*_: object) -> set[int]:
    libraries = threadpool_info()
    return {library["num_threads"] for library in libraries if library["user_api"] == "blas"}


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_each_worker_multiplies_on_one_core(kind):
    with threadpool_limits(3, user_api="blas"):
        with worker_pool(kind, None, N_WORKERS) as pool:
            assert list(pool.map(cores_of_products, range(4))) == [{1}] * 4
        assert cores_of_products() == {3}


def set_name(value: str = "begun") -> None:
    os.environ["DSNET_TEST_WORKER"] = value


def name(_: object, __: object) -> str | None:
    return os.environ.get("DSNET_TEST_WORKER")


@pytest.mark.parametrize("kind", KINDS)
def test_workers_are_initialised(kind, monkeypatch):
    monkeypatch.setenv("DSNET_TEST_WORKER", "no")
    with worker_pool(kind, None, N_WORKERS, initializer=set_name) as pool:
        assert list(pool.map(name, range(3))) == ["begun"] * 3


def sleep(_: object, seconds: float) -> None:
    time.sleep(seconds)


def be_interrupted() -> None:
    with worker_pool("processes", None, N_WORKERS) as pool:
        results = pool.map(sleep, [0.0, 600.0, 600.0, 600.0, 600.0, 600.0])
        next(results)
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_does_not_wait_for_work():
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        be_interrupted()
    assert not multiprocessing.active_children()
    assert time.monotonic() - began < 300


def refuse(_: object, item: str) -> None:
    raise DsnetError(item, "another", "Pass it.")


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_worker_refuses_is_refused_in_its_own_words(kind):
    expected = "^one; expected another. Pass it.$"
    with pytest.raises(DsnetError, match=expected), worker_pool(kind, None, N_WORKERS) as pool:
        list(pool.map(refuse, ["one", "one"]))


def be_killed(_: object, item: int) -> int:
    if item == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def test_a_killed_worker_is_one_line_and_keeps_what_the_stage_has_done(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    done = []

    def make(writer):
        mark = writer.checkpoints / "done"
        if mark.exists():
            done.append(mark.read_text())
            return
        mark.write_text("half")
        with worker_pool("processes", None, N_WORKERS) as pool:
            list(pool.map(be_killed, range(3)))

    def build():
        Run("x").build("toy", Config(), make, data="synthetic", upstream={})

    with pytest.raises(InterruptedWorkError, match="memory") as caught:
        build()
    assert "\n" not in str(caught.value)
    assert not multiprocessing.active_children()
    build()
    assert done == ["half"]


KILLED = """
import multiprocessing, os, signal
from bridge.runs.workers import worker_pool
from tests.bridge.runs.test_workers import sleep

if __name__ == "__main__":
    with worker_pool("processes", None, 2) as pool:
        next(pool.map(sleep, [0.0] * 1 + [600.0] * 5))
        print(*(process.pid for process in multiprocessing.active_children()), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
"""


INTERRUPTED = """
import os, time
from bridge.processes import exit_with_one_line
from bridge.runs.workers import worker_pool

def work(said, item):
    os.write(1, b"begun\\n")  # whole: lines that two threads print mix
    time.sleep(1)
    os.write(1, f"{said}\\n".encode())

with exit_with_one_line(), worker_pool("threads", "ended", 2) as pool:
    list(pool.map(work, range(5)))
"""


def test_no_thread_outlives_the_command_however_often_it_is_interrupted():
    """A library's code in a thread aborts the process when the interpreter ends before it."""
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout
            assert [process.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
            for _ in range(3):
                process.send_signal(signal.SIGINT)
                time.sleep(0.1)
            rest, said = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, rest.count("ended")) == (130, 2), said
    assert said.count("\n") == 1, said


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
    assert len(orphans) == N_WORKERS
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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--address", "10.0.0.1:6379"), "--address 10.0.0.1:6379 without a cluster"),
        (("--engine=local", "--address=auto"), "--address auto without a cluster"),
    ],
)
def test_slips_are_told_in_one_line(options, said, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["check", "--profile", "smoke", *options])
    assert caught.value.code == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert said in told[0]


def test_there_are_two_engines():
    with pytest.raises(DsnetError, match="spark; expected local or ray"), use_engine("spark"):
        pass


def test_the_local_engine_leaves_work_as_it_is():
    with use_engine("local"):
        assert on_any_node("threads") == "threads"


def _double(factor: int, item: int) -> int:
    if item < 0:
        raise DsnetError(f"item {item}", "0 or more", "Pass another.")
    return factor * item


@pytest.mark.cluster
def test_work_on_ray_comes_back_in_order_and_errors_keep_their_words():
    pytest.importorskip("ray", reason="Ray is not installed: extra ray")
    with use_engine("ray"):
        assert on_any_node("threads") == "ray"
        with worker_pool(on_any_node("serial"), 2) as pool:
            assert list(pool.map(_double, range(20))) == list(range(0, 40, 2))
            # What is no function of a module, too.
            assert list(pool.map(lambda factor, item: factor + item, [1, 2])) == [3, 4]
        with (
            pytest.raises(DsnetError, match=r"^item -1; expected 0 or more"),
            worker_pool("ray", 2) as pool,
        ):
            list(pool.map(_double, [1, -1]))
    assert on_any_node("threads") == "threads"


@pytest.mark.cluster
@pytest.mark.parametrize("address", ["127.0.0.1:1", "127.0.0.1:none"])
def test_no_cluster_at_an_address_is_one_line(address):
    pytest.importorskip("ray", reason="Ray is not installed: extra ray")
    refused = pytest.raises(DsnetError, match=f"{address}, where no Ray cluster answers")
    with refused, use_engine("ray", address):
        pass
