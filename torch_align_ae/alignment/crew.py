"""Work shared out to one process a core, each with a copy of the tools that all of it needs.

A step of the paper's descent is some hundred small operations, between which PyTorch needs
Python's lock: threads wait for one another there, processes do not. What large operations take is
shared out to `threads`, which begin at once and share memory.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

import torch

from torch_align_ae.alignment.threads import one_arithmetic_thread

Tools = TypeVar("Tools")
Item = TypeVar("Item")
Result = TypeVar("Result")


class Crew(Generic[Tools]):
    """Does work with its tools; made by `crew`."""

    def __init__(self, tools: Tools, pool: ProcessPoolExecutor | None) -> None:
        self._tools, self._pool = tools, pool

    def map(self, work: Callable[[Tools, Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """`work(tools, item)` of every item, in order; `work` is a function of a module."""
        if self._pool is None:
            for item in items:
                yield work(self._tools, item)
        else:
            # As bytes: PyTorch would pass each tensor through a file in shared memory, of which
            # a container has little.
            jobs = [self._pool.submit(_do, pickle.dumps((work, item))) for item in items]
            for job in jobs:
                yield pickle.loads(job.result())


@contextmanager
def crew(tools: Tools, hands: int) -> Iterator[Crew[Tools]]:
    """`hands` processes for the time of a `with` block; this one alone if that is 1."""
    if hands == 1:
        with one_arithmetic_thread():
            yield Crew(tools, None)
        return
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        hands, multiprocessing.get_context("spawn"), _begin, (pickle.dumps(tools),)
    )
    try:
        yield Crew(tools, pool)
    except BaseException:
        # Nobody will take what they are at: an interrupt does not wait for it.
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


_tools_of_this_process: Any = None


def _begin(tools: bytes) -> None:
    global _tools_of_this_process
    _tools_of_this_process = pickle.loads(tools)
    torch.set_num_threads(1)
    # An interrupt from the keyboard reaches every process; the first one alone answers it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed parent cannot end its processes, which would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _do(job: bytes) -> bytes:
    work, item = pickle.loads(job)
    return pickle.dumps(work(_tools_of_this_process, item))
