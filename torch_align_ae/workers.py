"""Workers that compute with PyTorch on one core each, and the device that trains networks.

Small products do not use several cores well, so each core gets a task of its own. As one thread
computes a task, its result does not depend on the number of cores.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import torch

from bridge.runs.workers import Kind, WorkerPool, worker_pool

Tools = TypeVar("Tools")


@contextmanager
def torch_workers(
    kind: Kind, tools: Tools, n_workers: int | None = None
) -> Iterator[WorkerPool[Tools]]:
    """A `bridge.runs.workers.worker_pool` in which PyTorch uses one thread.

    This holds for each worker, and for the calling process while it waits.
    """
    threads = torch.get_num_threads()
    _use_one_arithmetic_thread()
    try:
        with worker_pool(kind, tools, n_workers, _use_one_arithmetic_thread) as pool:
            yield pool
    finally:
        torch.set_num_threads(threads)


def _use_one_arithmetic_thread() -> None:
    torch.set_num_threads(1)


def device() -> torch.device:
    """The device on which networks are trained: a GPU if there is one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")
