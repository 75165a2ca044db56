"""Folders that a user names to be written: nothing of anybody else's is lost there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.errors import DsnetError
from bridge.runs import ArtifactWriter, read_artifact
from bridge.runs.artifact import DataOrigin
from bridge.runs.files import MANIFEST, exclusive, runs_root


@contextmanager
def open_out_folder(out: Path, origin: DataOrigin, kind: str) -> Iterator[ArtifactWriter]:
    """A writer of the artifact of a kind that will be `out`; an exception leaves nothing.

    A finished artifact replaces the folder of its name with all that is in it, so one that is in a
    run, or holds anything but an earlier one of its kind, is refused; one process at a time writes.
    """
    out = out.resolve()
    _refuse_foreign(out, kind)
    try:
        with exclusive(out, f"--out {out}", "Wait until it has ended, or name another folder."):
            _refuse_foreign(out, kind)  # once more: it may have been filled before we were alone
            yield ArtifactWriter(out, kind, data=origin)
    except OSError as error:
        raise DsnetError(
            f"--out {out}, which cannot be written ({error.strerror or error})",
            "a folder that can be made, on a disk with room",
            "Name another folder.",
        ) from error


def _refuse_foreign(out: Path, kind: str) -> None:
    if out.exists() and not out.is_dir():
        raise DsnetError(f"--out {out}, a file", "a folder to write", "Name another path.")
    if out.parent.parent == runs_root().resolve():
        raise DsnetError(
            f"--out {out}, a place for a stage of run {out.parent.name!r}",
            "a folder outside of the runs",
            "Name another folder.",
        )
    if out.is_dir() and (held := _foreign(out, kind)):
        raise DsnetError(
            f"--out {out}, which holds {held}",
            f"a new or empty folder, or one of an earlier {kind} and nothing else",
            "Name another folder.",
        )


def _foreign(out: Path, kind: str) -> str:
    """What in a folder is not of an earlier artifact of a kind, empty if nothing is."""
    there = min(out.iterdir(), default=None)
    if there is None:
        return ""
    try:
        artifact = read_artifact(out)
    except DsnetError:
        return f"other files such as {there.name}"
    if artifact.manifest["kind"] != kind:
        return f"an artifact of kind {artifact.manifest['kind']!r}"
    expected = {MANIFEST, *artifact.digests}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if name not in expected and (path.is_symlink() or not path.is_dir()):
            return f"{name} beside an earlier {kind}"
    return ""
