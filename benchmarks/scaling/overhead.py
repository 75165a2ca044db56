"""What a pool costs when there is nothing to do."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, nullcontext
from importlib.util import find_spec
from typing import Any

from bridge.runs.workers import Kind, use_engine, worker_pool

_KINDS: tuple[tuple[Kind, tuple[int, ...]], ...] = (
    ("serial", (1,)),
    ("threads", (1, 2)),
    ("processes", (1, 2)),
)


def nothing(tools: None, item: int) -> int:
    """A task without work."""
    return item


def overheads(tasks: int, with_ray: bool) -> list[dict[str, Any]]:
    """Seconds to begin and seconds a task, of every kind of pool."""
    found = [_overhead(kind, count, tasks) for kind, counts in _KINDS for count in counts]
    if with_ray and find_spec("ray"):
        found.append(_overhead("ray", None, tasks, use_engine("ray")))
    return found


def _overhead(
    kind: Kind, workers: int | None, tasks: int, engine: AbstractContextManager | None = None
) -> dict[str, Any]:
    with engine or nullcontext():
        started = time.perf_counter()
        with worker_pool(kind, None, workers) as pool:
            list(pool.map(nothing, range(2 * (workers or 1))))
            begun = time.perf_counter()
            list(pool.map(nothing, range(tasks)))
            done = time.perf_counter()
    return {
        "kind": kind,
        "workers": workers,
        "begin_s": begun - started,
        "task_s": (done - begun) / tasks,
    }
