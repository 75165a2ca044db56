"""Who computes with PyTorch: workers on one core each, or the processes that `torchrun` starts.

Small products on all cores at once mostly wait for one another; one piece of work a core keeps all
of them busy. And since a piece is always computed by one thread, no bit of it depends on how many
cores there are.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TypeVar

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

from bridge.errors import DsnetError
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


def process_count() -> int:
    """Of those that share each batch: all hold the same weights and take the same steps."""
    joined = distributed.is_available() and distributed.is_initialized()
    return distributed.get_world_size() if joined else 1


def leads() -> bool:
    """Whether this process is the one of them that decides, and that alone writes."""
    return process_count() == 1 or distributed.get_rank() == 0


def replicated(network: nn.Module) -> nn.Module:
    """The network whose gradients are the mean over all processes."""
    return DistributedDataParallel(network) if process_count() > 1 else network


def own_part(batch: Tensor) -> tuple[Tensor, float]:
    """This process's rows of a batch (B, ...), and the factor of their mean loss.

    With it the mean over processes is the mean over the batch, also where B does not divide.
    """
    if (count := process_count()) == 1:
        return batch, 1.0
    rows = batch.tensor_split(count)[distributed.get_rank()]
    return rows, len(rows) * count / len(batch)


def mean_over_processes(value: Tensor) -> Tensor:
    if (count := process_count()) > 1:
        distributed.all_reduce(value)
        value = value / count
    return value


def told(value: Told) -> Told:
    """What the leader says; the others' value is not asked for."""
    if process_count() == 1:
        return value
    box = [value]
    distributed.broadcast_object_list(box)
    return box[0]


def device() -> torch.device:
    """Where this process trains networks: its GPU, or the processor where there is none."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@contextmanager
def joined_by_torchrun() -> Iterator[None]:
    """With the processes that `torchrun` started, or alone.

    NCCL connects GPUs, of which each process takes one; Gloo connects processors.

    Raises
    ------
    DsnetError
        If a machine with GPUs has fewer of them than `torchrun` started processes.
    """
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield
        return
    if gpus := torch.cuda.device_count():
        if int(os.environ["LOCAL_WORLD_SIZE"]) > gpus:
            raise DsnetError(
                f"{os.environ['LOCAL_WORLD_SIZE']} processes on a machine of {gpus} GPU(s)",
                "a GPU for each",
                f"Pass torchrun --nproc-per-node {gpus}, or CUDA_VISIBLE_DEVICES= for none.",
            )
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("nccl" if gpus else "gloo", timeout=_PATIENCE)
    try:
        yield
    finally:
        distributed.destroy_process_group()
