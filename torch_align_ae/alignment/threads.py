"""Work shared out to one thread a core, each with arithmetic of its own.

That keeps all cores busier than one batch on all of them, and since a piece of work is always
computed by one thread, no result depends on how many cores there are.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")

# Pieces that wait, computed or begun, while one is taken: bounds memory.
_AHEAD_PER_CORE = 2


class Workers:
    """Threads that work on pieces; made by `workers`."""

    def __init__(self, pool: ThreadPoolExecutor) -> None:
        self._pool = pool

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Results in the order of the items; only a few more are begun than are taken."""
        waiting: deque[Future[Result]] = deque()
        try:
            for item in items:
                waiting.append(self._pool.submit(work, item))
                if len(waiting) > _AHEAD_PER_CORE * (os.cpu_count() or 1):
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


@contextmanager
def workers() -> Iterator[Workers]:
    """As many threads as cores for the time of a `with` block."""
    with (
        one_arithmetic_thread(),
        ThreadPoolExecutor(
            os.cpu_count(), initializer=torch.set_num_threads, initargs=(1,)
        ) as pool,
    ):
        yield Workers(pool)


@contextmanager
def one_arithmetic_thread() -> Iterator[None]:
    """For the time of a `with` block PyTorch computes on one core for each Python thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
