"""Where runs lie, and how files and folders come into place whole.

An artifact grows in `.<name>.partial` beside its folder. Once a manifest lies there it is complete:
`settle` puts it into place, now or, after a kill at any moment, when the folder is next asked for.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

MANIFEST = "manifest.json"
CHECKPOINTS = "checkpoints"


def runs_root() -> Path:
    """`runs/` below the working directory, or what `DSNET_RUNS` names."""
    return Path(os.environ.get("DSNET_RUNS", "runs"))


def is_finished(folder: Path) -> bool:
    """Whether `folder` holds a finished artifact."""
    return (folder / MANIFEST).is_file()


def write_text_atomically(path: Path, text: str) -> None:
    """Write `text` beside `path` and rename it into place."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    partial.write_text(text, encoding="utf-8", newline="\n")  # the same bytes on Windows
    os.replace(partial, path)


def partial_folder(folder: Path) -> Path:
    """Where the artifact `folder` is while it is being written."""
    return folder.with_name(f".{folder.name}.partial")


def is_unsettled(folder: Path) -> bool:
    """Whether a process that was killed left something for `settle` to do."""
    return is_finished(partial_folder(folder)) or _retired(folder).exists()


def settle(folder: Path) -> None:
    """Put a complete partial folder into place and remove what it replaces.

    Each step leaves a state from which the next call goes on, and one of the old and the new
    artifact is there throughout. Only the process that may write `folder` may call it.
    """
    partial, retired = partial_folder(folder), _retired(folder)
    if is_finished(partial):
        shutil.rmtree(partial / CHECKPOINTS, ignore_errors=True)
        # A folder cannot be renamed over a full one, so the old one steps aside first.
        if folder.exists():
            shutil.rmtree(retired, ignore_errors=True)
            folder.rename(retired)
        partial.rename(folder)
    elif retired.exists() and not folder.exists():
        retired.rename(folder)
    shutil.rmtree(retired, ignore_errors=True)


def _retired(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.retired")
