"""Workers that compute on one core each.

Small products on all cores at once mostly wait for one another; one piece of work a core keeps all
of them busy. And since a piece is always computed by one thread, no bit of it depends on how many
cores there are.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import torch

from bridge.runs.worker_pool import Kind, WorkerPool, worker_pool

Tools = TypeVar("Tools")


@contextmanager
def torch_workers(
    kind: Kind, tools: Tools, n_workers: int | None = None
) -> Iterator[WorkerPool[Tools]]:
    """A `bridge.runs.worker_pool` whose workers use one arithmetic thread."""
    with (
        one_arithmetic_thread(),
        worker_pool(kind, tools, n_workers, initializer=use_one_arithmetic_thread) as pool,
    ):
        yield pool


@contextmanager
def one_arithmetic_thread() -> Iterator[None]:
    """For the time of a `with` block PyTorch computes on one core for each Python thread."""
    threads = torch.get_num_threads()
    use_one_arithmetic_thread()
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def use_one_arithmetic_thread() -> None:
    """From now on PyTorch computes on one core for this thread."""
    torch.set_num_threads(1)
