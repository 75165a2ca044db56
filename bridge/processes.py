"""Stages of the other frameworks run as child processes: arrays pass on disk, never in memory."""

from __future__ import annotations

import subprocess
import sys


def run_module(module: str, *arguments: str) -> None:
    """Run `python -m module arguments`; a child that failed has said why, so pass on its status.

    Raises
    ------
    SystemExit
        With the child's exit status when it is not 0.
    """
    status = subprocess.run([sys.executable, "-m", module, *arguments], check=False).returncode
    if status:
        sys.exit(status)
