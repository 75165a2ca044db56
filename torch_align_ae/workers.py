"""Who computes with PyTorch: workers on one core each, and for networks a GPU where there is one.

Small products on all cores at once mostly wait for one another; one piece of work a core keeps all
of them busy. And since a piece is always computed by one thread, no bit of it depends on how many
cores there are.
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
    """A `bridge.runs.workers.worker_pool` whose workers, and who waits for them, use one arithmetic
    thread each."""
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
    """Where this process trains networks: its GPU, or the processor where there is none."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")
