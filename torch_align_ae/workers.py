"""Who computes with PyTorch: workers on one core each, or the processes that `torchrun` starts.

Small products on all cores at once mostly wait for one another; one piece of work a core keeps all
of them busy. And since a piece is always computed by one thread, no bit of it depends on how many
cores there are.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import TypeVar

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

from bridge.runs.workers import Kind, WorkerPool, worker_pool

Tools = TypeVar("Tools")
Told = TypeVar("Told")

# The leader also validates, fits PCA and writes files, while the others wait.
_PATIENCE = timedelta(days=1)


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


@dataclass(frozen=True)
class Processes:
    """This process's place among those that share each batch; alone unless told otherwise.

    All of them hold the same weights and take the same steps; one leads, and it alone writes.
    """

    rank: int = 0
    count: int = 1

    @property
    def leads(self) -> bool:
        return self.rank == 0

    def replicated(self, network: nn.Module) -> nn.Module:
        """The network whose gradients are the mean over all processes."""
        return DistributedDataParallel(network) if self.count > 1 else network

    def part(self, batch: Tensor) -> tuple[Tensor, float]:
        """This process's rows of a batch (B, ...), and the factor of their mean loss.

        With it the mean over processes is the mean over the batch, also where B does not divide.
        """
        if self.count == 1:
            return batch, 1.0
        rows = batch.tensor_split(self.count)[self.rank]
        return rows, len(rows) * self.count / len(batch)

    def mean(self, value: Tensor) -> Tensor:
        """The mean of a number over all processes."""
        if self.count > 1:
            distributed.all_reduce(value)
            value = value / self.count
        return value

    def told(self, value: Told) -> Told:
        """What the leader says; the others' value is not asked for."""
        if self.count == 1:
            return value
        box = [value]
        distributed.broadcast_object_list(box)
        return box[0]


@contextmanager
def started_by_torchrun() -> Iterator[Processes]:
    """The processes that `torchrun` started, or this one alone.

    NCCL connects GPUs, of which each process takes one; Gloo connects processors.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield Processes()
        return
    if gpus := torch.cuda.is_available():
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("nccl" if gpus else "gloo", timeout=_PATIENCE)
    try:
        yield Processes(distributed.get_rank(), count)
    finally:
        distributed.destroy_process_group()
