"""One process at a time: who writes a folder keeps all others out."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bridge.errors import DsnetError

try:
    import fcntl
except ModuleNotFoundError:
    fcntl = None
_REMOVABLE_WHILE_OPEN = os.name != "nt"
"""Whether a file can be removed while a process has it open, as everywhere but on Windows."""


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
            if _REMOVABLE_WHILE_OPEN:
                path.unlink(missing_ok=True)
    finally:
        os.close(descriptor)
        if not _REMOVABLE_WHILE_OPEN:
            with suppress(OSError):  # another process has opened it since, and will remove it
                path.unlink()


def lock_of(folder: Path) -> Path:
    """The file whose lock keeps others out of `folder`."""
    return folder.with_name(f".{folder.name}.lock")


def _locked(descriptor: int, path: Path) -> bool:
    try:
        if fcntl is None:
            # Not at the top: it takes longer to load than most commands need it for.
            from filelock import lock_descriptor

            if not lock_descriptor(descriptor, blocking=False):
                return False
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Whom it belonged to may have removed the file since it was opened.
        return not _REMOVABLE_WHILE_OPEN or os.path.samestat(os.fstat(descriptor), path.stat())
    except (BlockingIOError, FileNotFoundError):
        return False
