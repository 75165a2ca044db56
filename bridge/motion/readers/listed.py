"""A text file that names which motions of a folder are meant, one a line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from bridge.errors import DsnetError, did_you_mean

_COMMENT = re.compile(r"(^|\s)#.*")


def listed_files(listed: Path, folder: Path, names: Mapping[Path, str]) -> set[Path]:
    """Those of a folder's files that a list names by path below the folder or by their name.

    What follows `#` is a comment; order and repetition mean nothing. `DsnetError` if the list
    cannot be read, is empty, or names what is not there.

    Parameters
    ----------
    names : `<subject>_<motion>` of every file below `folder`; files in several releases share one.
    """
    by_entry: dict[str, set[Path]] = {}
    for path, name in names.items():
        for entry in (path.relative_to(folder).as_posix(), name.replace(" ", "_")):
            by_entry.setdefault(entry, set()).add(path)
    chosen: set[Path] = set()
    for number, line in enumerate(_lines_of(listed), start=1):
        entry = _COMMENT.sub("", line).strip().removeprefix("./")
        # A name may be written with the spaces that some files' names have.
        found = by_entry.get(entry) or by_entry.get(entry.replace(" ", "_"))
        if entry and not found:
            raise DsnetError(
                f"--amass-list {listed}, line {number}: {entry!r}",
                f"the path or the name (<subject>_<motion>) of a motion below {folder}",
                did_you_mean(entry, by_entry, "Correct the line, or remove it."),
            )
        chosen |= found or set()
    if not chosen:
        raise DsnetError(
            f"--amass-list {listed}, which names nothing",
            "a path or a name of a motion on each line",
            "Write them into it, or leave --amass-list out.",
        )
    return chosen


def _lines_of(listed: Path) -> list[str]:
    try:
        return listed.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text"
        raise DsnetError(
            f"--amass-list {listed}, which cannot be read ({why})",
            "a text file with the path or the name of a motion on each line",
            "Check the path.",
        ) from error
