"""A file or folder that is not there yet: written beside, and renamed when it is whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.errors import DsnetError
from bridge.runs.files import exclusive, partial_folder, runs_root


@contextmanager
def new_path(out: Path, flag: str = "--out") -> Iterator[Path]:
    """Where to write what will be `out`, which `flag` names; an exception leaves nothing.

    The path has the same name, so that writers which go by suffixes find theirs.

    Raises
    ------
    DsnetError
        If `out` is there, lies in a run, cannot be written, or another process is writing it.
    """
    refuse_taken(out, flag)
    out = out.resolve()
    partial = partial_folder(out)
    try:
        with exclusive(out, f"{flag} {out}", "Wait until it has ended, or name another path."):
            refuse_taken(out, flag)  # once more: it may have been made before we were alone
            shutil.rmtree(partial, ignore_errors=True)  # of a process that was killed
            partial.mkdir()
            try:
                yield partial / out.name
                os.replace(partial / out.name, out)
            finally:
                shutil.rmtree(partial)
    except OSError as error:
        raise DsnetError(
            f"{flag} {out}, which cannot be written ({error.strerror or error})",
            "a path that can be made, on a disk with room",
            "Name another path.",
        ) from error


def refuse_taken(out: Path, flag: str = "--out") -> None:
    """Refuse a path that is there, or lies in a run.

    Raises
    ------
    DsnetError
        If it does.
    """
    if os.path.lexists(out):
        raise DsnetError(
            f"{flag} {out}, which exists", "a new path", "Remove it, or name another path."
        )
    if runs_root().resolve() in out.resolve().parent.parents:
        raise DsnetError(
            f"{flag} {out}, a path in a run",
            "a path outside of the runs",
            "Name another path.",
        )
