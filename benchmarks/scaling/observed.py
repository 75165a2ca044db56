"""A `dsnet` command with a given number of workers, and what its pools were doing meanwhile.

    python -c 'from benchmarks.scaling.observed import main; main()' 2 OUT.json align --run demo

writes the seconds of the command's own work and of every phase, a phase being what one function
does in a pool. A pool whose work uses another pool is left out: the inner one is counted.
"""

from __future__ import annotations

import json
import pickle
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from bridge.runs.workers import WorkerPool, use_workers
from dsnet.cli import main as dsnet

_IO = Path("/proc/self/io")


@dataclass
class Phase:
    """What one function did, over all calls of `WorkerPool.map`."""

    calls: int = 0
    tasks: int = 0
    wall_s: float = 0.0
    busy_s: float = 0.0
    """Of all tasks together."""
    longest_s: float = 0.0
    sent_bytes: int = 0
    """Of tasks as they would go to another machine."""
    back_bytes: int = 0
    """Of results, likewise."""
    read_bytes: int = 0
    """By this process while the phase ran; what is mapped into memory is not counted."""
    written_bytes: int = 0


@dataclass
class ObservedPools:
    """The phases of a process by the function's name."""

    phases: dict[str, Phase] = field(default_factory=dict)
    running: int = 0
    begun: int = 0

    def map(
        self, through: Callable[..., Iterator[Any]], pool: WorkerPool, work: Any, items: Iterable
    ) -> Iterator[Any]:
        """As `WorkerPool.map`, whose original is `through`."""
        own, seen = Phase(calls=1), []
        self.begun += 1
        before, started, moved = self.begun, time.perf_counter(), _moved_bytes()
        for seconds, result in through(pool, partial(_timed, work), _kept(items, seen)):
            own.tasks += 1
            own.busy_s += seconds
            own.longest_s = max(own.longest_s, seconds)
            own.back_bytes += _size(result)
            yield result
        own.wall_s = time.perf_counter() - started
        own.read_bytes, own.written_bytes = (
            now - then for now, then in zip(_moved_bytes(), moved, strict=True)
        )
        own.sent_bytes = sum(map(_size, seen))
        if self.begun == before:  # else its tasks have pools of their own
            self._add(_name(work), own)

    def _add(self, name: str, own: Phase) -> None:
        total = self.phases.setdefault(name, Phase())
        longest_s = max(total.longest_s, own.longest_s)
        for key, value in asdict(own).items():
            setattr(total, key, getattr(total, key) + value)
        total.longest_s = longest_s


def main() -> None:
    """Entry point: number of workers, file to write, settings, and the command with its options."""
    workers, out, settings, *command = sys.argv[1:]
    use_workers(int(workers))
    observed, original = ObservedPools(), WorkerPool.map

    def observing(pool: WorkerPool, work: Any, items: Iterable[Any]) -> Iterator[Any]:
        return observed.map(original, pool, work, items)

    setattr(WorkerPool, "map", observing)  # noqa: B010
    started = time.perf_counter()
    dsnet(command, **json.loads(settings))
    wall_s = time.perf_counter() - started
    phases = {name: asdict(phase) for name, phase in observed.phases.items()}
    Path(out).write_text(json.dumps({"wall_s": wall_s, "phases": phases}), encoding="utf-8")


def _name(work: Any) -> str:
    """Of the function that does the work, the same in every process."""
    while isinstance(work, partial):
        work = work.func
    return getattr(work, "__qualname__", type(work).__qualname__)


def _timed(work: Any, tools: Any, item: Any) -> tuple[float, Any]:
    started = time.perf_counter()
    result = work(tools, item)
    return time.perf_counter() - started, result


def _kept(items: Iterable[Any], seen: list[Any]) -> Iterator[Any]:
    for item in items:
        seen.append(item)
        yield item


def _size(value: Any) -> int:
    """Pickled; 0 of what cannot be, and so never leaves the process."""
    try:
        return len(pickle.dumps(value))
    except (pickle.PicklingError, AttributeError, TypeError):
        return 0


def _moved_bytes() -> tuple[int, int]:
    """Read and written so far; nothing where the system does not say."""
    if not _IO.exists():
        return 0, 0
    counts = dict(line.split(": ") for line in _IO.read_text(encoding="utf-8").splitlines())
    return int(counts["rchar"]), int(counts["wchar"])
