"""The folder of `--out`: whose it is, and one process at a time in it.

A finished artifact replaces the folder of its name with all that is in it, so a folder that holds
anything but an earlier prediction is refused.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.errors import DsnetError
from bridge.runs import ArtifactWriter, read_artifact
from bridge.runs.artifact import MANIFEST, DataOrigin
from bridge.runs.run import runs_root

KIND = "prediction"


@contextmanager
def open_out_folder(out: Path, origin: DataOrigin) -> Iterator[ArtifactWriter]:
    """A writer of the artifact of kind `prediction` that will be `out`; an exception discards it.

    Raises
    ------
    DsnetError
        If `out` is in a run, holds anything but an earlier prediction, cannot be written, or is
        being written by another process.
    """
    out = out.resolve()
    _refuse_foreign(out)
    try:
        with _alone(out):
            _refuse_foreign(out)  # once more: it may have been filled before we were alone
            writer = ArtifactWriter(out, KIND, data=origin)
            try:
                yield writer
            except BaseException:  # an interrupt, too: there is nothing to go on from
                writer.discard()
                raise
    except OSError as error:
        raise DsnetError(
            f"--out {out}, which cannot be written ({error.strerror or error})",
            "a folder that can be made, on a disk with room",
            "Name another folder.",
        ) from error


def _refuse_foreign(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise DsnetError(f"--out {out}, a file", "a folder to write", "Name another path.")
    if out.parent.parent == runs_root().resolve():
        raise DsnetError(
            f"--out {out}, a place for a stage of run {out.parent.name!r}",
            "a folder outside of the runs",
            "Name another folder.",
        )
    if out.is_dir() and (held := _foreign(out)):
        raise DsnetError(
            f"--out {out}, which holds {held}",
            "a new or empty folder, or one of an earlier prediction and nothing else",
            "Name another folder.",
        )


def _foreign(out: Path) -> str:
    """What in a folder is not an earlier prediction's, empty if nothing is."""
    there = min(out.iterdir(), default=None)
    if there is None:
        return ""
    try:
        manifest = read_artifact(out).manifest
    except DsnetError:
        return f"other files such as {there.name}"
    if manifest["kind"] != KIND:
        return f"an artifact of kind {manifest['kind']!r}"
    own = {MANIFEST, *manifest["files"], *(f"{name}.npy" for name in manifest["arrays"])}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if name not in own and (path.is_symlink() or not path.is_dir()):
            return f"{name} beside an earlier prediction"
    return ""


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Keep other processes out of `out`; the system lets go when a process is killed."""
    out.parent.mkdir(parents=True, exist_ok=True)
    path = out.with_name(f".{out.name}.lock")
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The file may have been removed, by whom it belonged to, since it was opened.
            mine = path.exists() and os.path.samestat(os.fstat(descriptor), path.stat())
        except BlockingIOError:
            mine = False
        if not mine:
            raise DsnetError(
                f"--out {out}, which another process is writing",
                "one process at a time",
                "Wait until it has ended, or name another folder.",
            )
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
    finally:
        os.close(descriptor)
