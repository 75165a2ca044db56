"""One process at a time: who writes a folder keeps all others out."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from bridge.errors import DsnetError
from bridge.runs.folders import runs_root


@contextmanager
def exclusive(folder: Path, what: str, remedy: str) -> Iterator[None]:
    """Keep other processes out of `folder`, which need not exist nor lie in the runs' folder.

    The system lets go when a process is killed.

    Parameters
    ----------
    what, remedy : str
        Named in the refusal, such as "stage 'align' of run 'demo'" and "Pass another --run.".

    Raises
    ------
    DsnetError
        If another process is writing the folder.
    """
    lock = FileLock(_lock_file(folder))
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise DsnetError(
            f"{what}, which another process is making", "one process at a time", remedy
        ) from None
    try:
        yield
    finally:
        lock.release()


def _lock_file(folder: Path) -> Path:
    """Apart from the folder, which a refused input leaves as it was."""
    locks = runs_root() / ".locks"
    locks.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()
    return locks / f"{digest[:16]}.lock"
