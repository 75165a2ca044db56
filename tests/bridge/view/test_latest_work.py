"""Work that nobody wants any more is dropped; what is still wanted goes on."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from bridge.view.latest_work import LatestWork


@pytest.fixture
def worker() -> Iterator[LatestWork]:
    found = LatestWork()
    yield found
    found.stop()


def test_work_is_done_in_order(worker):
    done: list[str] = []

    def work(name: str, steps: int) -> Iterator[None]:
        for _ in range(steps):
            yield
        done.append(name)

    worker.want({"a": lambda: work("a", 3), "b": lambda: work("b", 0)})
    assert worker.wait(5)
    assert done == ["a", "b"]


def test_what_is_under_way_is_dropped_or_goes_on(worker):
    begun, go, started = [], threading.Semaphore(0), threading.Event()

    def endless(name: str) -> Iterator[None]:
        begun.append(name)
        started.set()
        while True:
            go.acquire()
            yield

    def short() -> Iterator[None]:
        begun.append("short")
        yield

    worker.want({"a": lambda: endless("a")})
    assert started.wait(5)
    go.release()
    worker.want({"a": lambda: endless("a again")})
    go.release()
    worker.want({"short": short})
    go.release(2)
    assert worker.wait(5)
    assert begun == ["a", "short"]


def test_a_long_step_can_be_dropped_within(worker):
    begun, done = threading.Event(), []

    def long() -> Iterator[None]:
        begun.set()
        while True:
            worker.go_on("long")
        yield

    def short() -> Iterator[None]:
        done.append("short")
        yield

    worker.want({"long": long})
    assert begun.wait(5)
    worker.want({"short": short})
    assert worker.wait(5)
    assert done == ["short"]
    assert not worker.failed


def test_a_failure_is_kept_and_the_rest_is_done(worker):
    done = []

    def failing() -> Iterator[None]:
        yield
        raise ValueError("no")

    def fine() -> Iterator[None]:
        done.append("fine")
        yield

    worker.want({"bad": failing, "fine": fine})
    assert worker.wait(5)
    assert done == ["fine"]
    assert str(worker.failed["bad"]) == "no"
    worker.want({"bad": failing})
    assert worker.wait(5)
