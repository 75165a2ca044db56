"""One process at a time: who writes a folder keeps all others out."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.errors import DsnetError


@contextmanager
def exclusive(folder: Path, what: str, remedy: str) -> Iterator[None]:
    """Keep other processes out of `folder`, which need not exist yet.

    The system lets go when a process is killed; the lock, a file beside the folder, goes with the
    next one.

    Parameters
    ----------
    what, remedy : str
        Named in the refusal, such as "stage 'align' of run 'demo'" and "Pass another --run.".

    Raises
    ------
    DsnetError
        If another process is writing the folder.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    path = lock_of(folder)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if not _locked(descriptor, path):
            raise DsnetError(
                f"{what}, which another process is making", "one process at a time", remedy
            )
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def lock_of(folder: Path) -> Path:
    """The file whose lock keeps others out of `folder`."""
    return folder.with_name(f".{folder.name}.lock")


def _locked(descriptor: int, path: Path) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Whom it belonged to may have removed the file since it was opened.
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except (BlockingIOError, FileNotFoundError):
        return False
