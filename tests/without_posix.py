"""Run code as on Windows, as far as that can be had elsewhere.

    python -X warn_default_encoding tests/without_posix.py CODE ARGUMENT ...

The product's modules cannot import what Windows lacks, names of `os` and `signal` that Windows or
macOS lack are gone, a file that is open or mapped can be neither removed nor renamed, nor can a
folder above it, and a text file that is opened in the locale's encoding is an error.
"""

from __future__ import annotations

import builtins
import os
import signal
import sys
import warnings
from pathlib import Path
from typing import Any

from tests.sources import PACKAGES

MODULES = ("fcntl", "grp", "pwd", "resource", "termios")
OF_OS = ("O_NONBLOCK", "fdatasync", "fork", "getloadavg", "killpg", "posix_fallocate", "pwrite")
MOVES = {"os.rename": 2, "os.remove": 1, "os.rmdir": 1}
"""Events of the interpreter, and how many paths each has before its folders' descriptors."""


def refuse_posix_modules() -> None:
    """Raise ModuleNotFoundError where a module of the product imports one of them."""
    original = builtins.__import__

    def imported(name: str, variables: Any = None, *others: Any, **named: Any) -> Any:
        importer = str((variables or {}).get("__name__", ""))
        if name in MODULES and importer.partition(".")[0] in PACKAGES:
            raise ModuleNotFoundError(f"No module named {name!r}")
        return original(name, variables, *others, **named)

    builtins.__import__ = imported


def hide_posix_names() -> None:
    """Remove what `os` and `signal` lack elsewhere."""
    for name in OF_OS:
        delattr(os, name)
    del signal.pthread_sigmask


def in_use() -> set[str]:
    """Files that this process has open or mapped."""
    with open("/proc/self/maps", encoding="utf-8") as maps:
        mapped = {line.split(maxsplit=5)[5].rstrip("\n") for line in maps if "/" in line}
    opened = (link for link in Path("/proc/self/fd").iterdir() if link.is_file())
    return mapped | {os.path.realpath(link) for link in opened}


def keep_files_in_use(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse to move a file that somebody here uses, as Windows does."""
    count = MOVES.get(event, 0)
    for path, folder in zip(arguments[:count], arguments[count:], strict=False):
        base = f"/proc/self/fd/{folder}" if folder >= 0 else "."
        place = os.path.realpath(os.path.join(base, os.fsdecode(path)))  # noqa: PTH118
        if held := [name for name in in_use() if f"{name}/".startswith(f"{place}/")]:
            raise PermissionError(13, f"in use: {held}", place)


def become_another_platform() -> None:
    """Do all of it in this process, for good."""
    hide_posix_names()
    refuse_posix_modules()
    warnings.simplefilter("ignore", EncodingWarning)
    ours = "|".join(PACKAGES)
    warnings.filterwarnings("error", category=EncodingWarning, module=rf"({ours})\b")
    sys.addaudithook(keep_files_in_use)


if __name__ == "__main__":
    become_another_platform()
    code, sys.argv = sys.argv[1], sys.argv[1:]
    exec(code)
