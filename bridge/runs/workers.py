"""Independent pieces of work, shared out to workers: results in order, whoever computes them.

`serial` works when a result is taken. `threads` share memory: right for large operations, during
which Python's lock is free. `processes` have a lock and a copy of the tools each: right for many
small operations, between which threads would wait for one another. `ray` is a process on any node
of a cluster: there work writes what is large into files (`ArrayFile`) itself, and its results are
small.

NumPy's products would take every core for each worker, and then wait for one another: small ones
took four times as long on two cores. So each thread and process multiplies on one.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import signal
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from functools import cache, lru_cache, partial
from types import ModuleType
from typing import Any, Generic, Literal, TypeVar

from threadpoolctl import threadpool_limits
from tqdm import tqdm

from bridge.errors import DsnetError, InterruptedWorkError
from bridge.installation import require_package
from bridge.processes import interrupts_withheld, usable_cores

Tools = TypeVar("Tools")
Item = TypeVar("Item")
Result = TypeVar("Result")

Kind = Literal["serial", "threads", "processes", "ray"]
Work = Callable[[Any, Any], Any]
Initializer = Callable[[], object] | None
# Pieces that wait, computed or begun, while one is taken: bounds memory.
_AHEAD_PER_WORKER = 2
# On a cluster more wait for a free core: nobody is idle while results are taken in order.
_AHEAD_PER_CORE = 3
# A task whose worker or node is lost is done again elsewhere, so many times.
_RETRIES = 5
# Of the driver, and what a worker on a cluster must know besides its work.
_PASSED_ON = ("DSNET_RUNS", "DSNET_PLUGINS", "PYTHONPATH")

_has_cluster = False
_workers_by_default: int | None = None
_tools_of_this_process: Any = None


class WorkerPool(Generic[Tools]):
    """Does work with its tools; made by `worker_pool`.

    `begin` begins a piece of work and gives what waits for its result; so many may be `ahead` of
    the one whose result is taken.
    """

    def __init__(self, begin: Callable[[Work, Any], Callable[[], Any]], ahead: int) -> None:
        self._begin, self._ahead = begin, ahead

    def map(self, work: Callable[[Tools, Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """`work(tools, item)` of every item, in their order; a few more are begun than are taken.

        Processes need `work` to be a function of a module; items and results are pickled then.
        """
        begun: deque[Callable[[], Any]] = deque()
        for item in items:
            begun.append(self._begin(work, item))
            if len(begun) > self._ahead:
                yield begun.popleft()()
        while begun:
            yield begun.popleft()()


def use_workers(count: int) -> None:
    """From now on pools of this process have so many workers unless `n_workers` is passed."""
    global _workers_by_default
    _workers_by_default = count


def worker_pool(
    kind: Kind,
    tools: Tools,
    n_workers: int | None = None,
    initializer: Initializer = None,
) -> AbstractContextManager[WorkerPool[Tools]]:
    """A pool for the time of a `with` block.

    `tools` are what all work needs: threads share them, each process has a copy. Without
    `n_workers`, on which no result depends, and in a cluster there is one a core. `initializer` is
    called once in each thread or process before its work; a function of a module. Where the system
    ends a process, as when memory runs out, or a cluster gives up: InterruptedWorkError.
    """
    count = n_workers or _workers_by_default or usable_cores()
    if kind == "serial":
        return _serial(tools, initializer)
    if kind == "ray":
        return _cluster(tools, initializer)
    return (_threads if kind == "threads" else _processes)(tools, count, initializer)


@contextmanager
def _serial(tools: Tools, initializer: Initializer) -> Iterator[WorkerPool[Tools]]:
    if initializer:
        initializer()
    yield WorkerPool(lambda work, item: partial(work, tools, item), ahead=0)


@contextmanager
def _threads(tools: Tools, count: int, initializer: Initializer) -> Iterator[WorkerPool[Tools]]:
    executor = ThreadPoolExecutor(count, initializer=initializer)
    with threadpool_limits(1, user_api="blas"):
        try:
            yield WorkerPool(
                lambda work, item: executor.submit(work, tools, item).result,
                _AHEAD_PER_WORKER * count,
            )
        finally:
            executor.shutdown(cancel_futures=True)


@contextmanager
def _processes(tools: Tools, count: int, initializer: Initializer) -> Iterator[WorkerPool[Tools]]:
    others = set(multiprocessing.active_children())
    # As bytes, here and below: PyTorch teaches `multiprocessing` to pass each tensor through a
    # file in shared memory, of which a container has little.
    begins_with = (pickle.dumps((tools, initializer)),)
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(count, context, _begin_process, begins_with)

    def begin(work: Work, item: Any) -> Callable[[], Any]:
        with interrupts_withheld():  # the executor begins its processes when it is given work
            done = executor.submit(_do_in_process, pickle.dumps((work, item)))
        return lambda: pickle.loads(done.result())

    try:
        yield WorkerPool(begin, _AHEAD_PER_WORKER * count)
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
        executor.shutdown(cancel_futures=True)


def _begin_process(pickled: bytes) -> None:
    global _tools_of_this_process
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


def _do_in_process(pickled: bytes) -> bytes:
    work, item = pickle.loads(pickled)
    _multiply_on_one_core()  # now that the work's modules have loaded their libraries
    return pickle.dumps(work(_tools_of_this_process, item))


@cache
def _multiply_on_one_core() -> None:
    threadpool_limits(1, user_api="blas")


@contextmanager
def use_engine(name: str, address: str | None = None) -> Iterator[None]:
    """Choose for the time of a `with` block where work is done that can leave this machine.

    `local`, or `ray`: the nodes of the running Ray cluster at `address`, as `ray.init` takes it;
    None starts one on this machine.
    """
    global _has_cluster
    if name not in ("local", "ray"):
        raise DsnetError(f"--engine {name}", "local or ray", "Pass --engine ray.")
    if name == "ray":
        ray, before, _has_cluster = _connected(address), _has_cluster, True
        try:
            yield
        finally:
            _has_cluster = before
            ray.shutdown()
    elif address is None:
        yield
    else:
        received = f"--address {address} without a cluster"
        raise DsnetError(received, "--engine ray", "Pass --engine ray.")


def on_any_node(kind: Kind) -> Kind:
    """`ray` if that engine is chosen, for work that can leave this machine; else `kind`."""
    return "ray" if _has_cluster else kind


def _connected(address: str | None) -> ModuleType:
    require_package("ray", "ray", "--engine ray")
    # Read when Ray is imported: nothing is reported to anybody, and work without a GPU sees what
    # the machine has.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    import ray

    # What workers make lies in files, so Ray's store of objects holds little.
    local = {} if address else {"include_dashboard": False, "object_store_memory": 256 << 20}
    variables = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    at_end = signal.getsignal(signal.SIGTERM)
    try:
        host, colon, port = (address or "").rpartition(":")
        if colon:  # Ray itself tries for minutes
            socket.create_connection((host, int(port)), timeout=10).close()
        ray.init(
            address=address or "local",
            runtime_env={"env_vars": variables},
            log_to_driver=False,
            logging_level=logging.CRITICAL,
            **local,
        )
    except (OSError, ValueError) as error:
        if address is None:
            raise
        raise DsnetError(
            f"--address {address}, where no Ray cluster answers",
            "HOST:PORT of its head node, or auto on one of its nodes",
            "Start one with `ray start --head`.",
        ) from error
    signal.signal(signal.SIGTERM, at_end)  # that of Ray exits with another status
    return ray


@contextmanager
def _cluster(tools: Tools, initializer: Initializer) -> Iterator[WorkerPool[Tools]]:
    """A pool whose work is done by the cluster that Ray is connected to, a task a core."""
    import ray
    from ray import exceptions

    task = ray.remote(num_cpus=1, max_retries=_RETRIES, scheduling_strategy="SPREAD")(_do_on_node)
    cores = int(ray.cluster_resources().get("CPU", 1))

    @lru_cache(maxsize=1)
    def sent(work: Work) -> Any:
        """What all pieces need goes to each node once."""
        return ray.put((work, tools, initializer))

    try:
        yield WorkerPool(
            # In a list, or Ray would unpack it anew for every task.
            lambda work, item: partial(ray.get, task.remote([sent(work)], item)),
            _AHEAD_PER_CORE * max(cores, 1),
        )
    except exceptions.RayTaskError as error:
        raise error.cause from None
    except exceptions.RayError as error:
        raise InterruptedWorkError(
            f"work that the cluster gave up ({str(error).splitlines()[0]})",
            "nodes that stay, with enough memory and disk",
            "Mend the cluster and run the same command: it goes on where it was.",
        ) from error


def _do_on_node(sent: list[Any], item: Any) -> Any:
    work, tools = _unpacked(sent[0])
    return work(tools, item)


@lru_cache(maxsize=1)
def _unpacked(sent: Any) -> tuple[Work, Any]:
    import ray

    work, tools, initializer = ray.get(sent)
    use_workers(1)
    if initializer:
        initializer()
    return work, tools


def progress(
    items: Iterable[Item] = (), *, what: str, unit: str, total: int | None = None
) -> tqdm[Item]:
    """A bar on stderr, where that is a terminal or DSNET_PROGRESS is set: done of all, rate and
    time left.

    It counts items as they are taken, or what is passed to its `update`; `total` is how many there
    will be where `items` have no length.
    """
    disabled = False if os.environ.get("DSNET_PROGRESS") else None  # None: where no terminal is
    return tqdm(items, desc=what, unit=unit, total=total, disable=disabled)
