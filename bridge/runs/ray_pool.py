"""The worker pool's work as tasks on a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any

import ray
from ray import exceptions

from bridge.errors import InterruptedWorkError
from bridge.runs import worker_pool

# A task whose worker or node is lost is done again elsewhere, so many times.
_RETRIES = 5
# Tasks that wait for a free core, for each core: nobody is idle while results are taken in order.
_AHEAD_PER_CORE = 3


@contextmanager
def ray_pool(
    tools: Any, initializer: Callable[[], object] | None
) -> Iterator[worker_pool.WorkerPool]:
    """A pool whose work is done by the cluster that Ray is connected to, a task a core.

    Raises
    ------
    InterruptedWorkError
        If a task's workers were lost again and again.
    """
    cores = int(ray.cluster_resources().get("CPU", 1))
    try:
        yield worker_pool.WorkerPool(_Sender(tools, initializer), _AHEAD_PER_CORE * max(cores, 1))
    except exceptions.RayTaskError as error:
        raise error.cause from None
    except exceptions.RayError as error:
        raise InterruptedWorkError(
            f"work that the cluster gave up ({str(error).splitlines()[0]})",
            "nodes that stay, with enough memory",
            "Mend the cluster and run the same command: it goes on where it was.",
        ) from error


class _Sender:
    """Begins pieces of work; what all of them need is sent to each node once."""

    def __init__(self, tools: Any, initializer: Callable[[], object] | None) -> None:
        self._tools, self._initializer = tools, initializer
        self._work: worker_pool.Work | None = None
        self._sent: Any = None

    def __call__(self, work: worker_pool.Work, item: Any) -> _Task:
        if work is not self._work:
            self._work, self._sent = work, ray.put((work, self._tools, self._initializer))
        # In a list, or Ray would unpack it anew for every task.
        return _Task(_do.remote([self._sent], item))


class _Task:
    """Work that some node does."""

    def __init__(self, result: Any) -> None:
        self._result = result

    def result(self) -> Any:
        return ray.get(self._result)

    def cancel(self) -> None:
        with suppress(exceptions.RayError):
            ray.cancel(self._result)


@ray.remote(num_cpus=1, max_retries=_RETRIES, scheduling_strategy="SPREAD")
def _do(sent: list[Any], item: Any) -> Any:
    work, tools = _unpacked(sent[0])
    return work(tools, item)


@lru_cache(maxsize=1)
def _unpacked(sent: Any) -> tuple[worker_pool.Work, Any]:
    work, tools, initializer = ray.get(sent)
    worker_pool.use_workers(1)
    if initializer:
        initializer()
    return work, tools
