"""Independent pieces of work, shared out to workers: results in order, whoever computes them.

A kind of pool is a way to begin one piece of work and a way to end everything. `serial` begins a
piece when its result is taken. `threads` begin at once and share memory: right for large
operations, during which Python's lock is free. `processes` have a lock and a copy of the tools
each: right for many small operations, between which threads would wait for one another. `ray` is a
process on any node of a cluster: there work writes what is large into files (`ArrayFile`) itself,
and its results are small.

NumPy's products would take every core for each worker, and then wait for one another: small ones
took four times as long on two cores. So each thread and process multiplies on one.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from functools import cache, partial
from typing import Any, Generic, Literal, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from bridge.endings import ignore_interrupts, interrupts_withheld, signals_postponed
from bridge.errors import InterruptedWorkError
from bridge.runs.engines import chosen_engine

Tools = TypeVar("Tools")
Item = TypeVar("Item")
Result = TypeVar("Result")

Kind = Literal["serial", "threads", "processes", "ray"]
Work = Callable[[Any, Any], Any]
# Pieces that wait, computed or begun, while one is taken: bounds memory.
_AHEAD_PER_WORKER = 2
_workers_by_default: int | None = None


class _Job(Protocol):
    """A piece of work that was begun."""

    def result(self) -> Any: ...
    def cancel(self) -> object: ...


class WorkerPool(Generic[Tools]):
    """Does work with its tools; made by `worker_pool`."""

    def __init__(self, begin: Callable[[Work, Any], _Job], ahead: int) -> None:
        self._begin, self._ahead = begin, ahead

    def map(self, work: Callable[[Tools, Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """`work(tools, item)` of every item, in their order; a few more are begun than are taken.

        Processes need `work` to be a function of a module; items and results are pickled then.
        """
        begun: deque[_Job] = deque()
        try:
            for item in items:
                begun.append(self._begin(work, item))
                if len(begun) > self._ahead:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for job in begun:
                job.cancel()


def on_any_node(kind: Kind) -> Kind:
    """`ray` if that engine is chosen, for work that can leave this machine; else `kind`."""
    return "ray" if chosen_engine() == "ray" else kind


def use_workers(count: int) -> None:
    """From now on pools of this process have so many workers unless told otherwise."""
    global _workers_by_default
    _workers_by_default = count


def worker_pool(
    kind: Kind,
    tools: Tools,
    n_workers: int | None = None,
    initializer: Callable[[], object] | None = None,
) -> AbstractContextManager[WorkerPool[Tools]]:
    """A pool for the time of a `with` block.

    Parameters
    ----------
    tools : what all work needs; threads share it, each process has a copy.
    n_workers : threads or processes; one a core when None. No result depends on it. A cluster has
        one for each of its cores.
    initializer : called once in each thread or process before its work; a function of a module.

    Raises
    ------
    InterruptedWorkError
        If the system ends a process, as it does when memory runs out.
    """
    count = n_workers or _workers_by_default or os.cpu_count() or 1
    if kind == "serial":
        return _serial(tools, initializer)
    if kind == "ray":
        from bridge.runs.ray_pool import ray_pool

        return ray_pool(tools, initializer)
    make = _threads if kind == "threads" else _processes
    return make(tools, count, initializer)


@contextmanager
def _serial(tools: Tools, initializer: Callable[[], object] | None) -> Iterator[WorkerPool[Tools]]:
    if initializer:
        initializer()
    yield WorkerPool(lambda work, item: _Postponed(work, tools, item), ahead=0)


class _Postponed:
    """Work that is done when its result is asked for."""

    def __init__(self, work: Work, tools: Any, item: Any) -> None:
        self._call = work, tools, item

    def result(self) -> Any:
        work, tools, item = self._call
        return work(tools, item)

    def cancel(self) -> None:
        """Nothing has begun."""


@contextmanager
def _threads(
    tools: Tools, count: int, initializer: Callable[[], object] | None
) -> Iterator[WorkerPool[Tools]]:
    executor = ThreadPoolExecutor(count, initializer=initializer)
    with threadpool_limits(1, user_api="blas"):
        try:
            yield WorkerPool(
                lambda work, item: executor.submit(work, tools, item), _AHEAD_PER_WORKER * count
            )
        finally:
            with signals_postponed():
                executor.shutdown(cancel_futures=True)


@contextmanager
def _processes(
    tools: Tools, count: int, initializer: Callable[[], object] | None
) -> Iterator[WorkerPool[Tools]]:
    others = set(multiprocessing.active_children())
    # As bytes, here and below: PyTorch teaches `multiprocessing` to pass each tensor through a
    # file in shared memory, of which a container has little.
    begins_with = (pickle.dumps((tools, initializer)),)
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(count, context, _begin_process, begins_with)
    try:
        yield WorkerPool(partial(_begin_in_process, executor), _AHEAD_PER_WORKER * count)
    except BaseException as error:
        # Nobody will take what they are at: an interrupt does not wait for it.
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        if isinstance(error, BrokenProcessPool):
            raise InterruptedWorkError(
                f"a worker process that the system ended, one of {count}",
                "enough memory for all of them",
                "Free memory and run the same command: it goes on where it was.",
            ) from error
        raise
    finally:
        with signals_postponed():
            executor.shutdown(cancel_futures=True)


def _begin_in_process(executor: ProcessPoolExecutor, work: Work, item: Any) -> _InProcess:
    # The executor begins its processes when it is given work.
    with interrupts_withheld():
        return _InProcess(executor.submit(_do, pickle.dumps((work, item))))


class _InProcess:
    """Work that another process does."""

    def __init__(self, future: Future[bytes]) -> None:
        self._future = future

    def result(self) -> Any:
        return pickle.loads(self._future.result())

    def cancel(self) -> bool:
        return self._future.cancel()


@cache
def _multiply_on_one_core() -> None:
    threadpool_limits(1, user_api="blas")


_tools_of_this_process: Any = None


def _begin_process(pickled: bytes) -> None:
    global _tools_of_this_process
    ignore_interrupts()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _tools_of_this_process, initializer = pickle.loads(pickled)
    if initializer:
        initializer()


def _end_with_parent() -> None:
    """A killed parent cannot end its processes, which would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _do(pickled: bytes) -> bytes:
    work, item = pickle.loads(pickled)
    _multiply_on_one_core()  # now that the work's modules have loaded their libraries
    return pickle.dumps(work(_tools_of_this_process, item))
