"""Studies as commands, and commands that a study runs: a framework in each process."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import tyro

from bridge.errors import InterruptedWorkError
from bridge.processes import Terminated, exit_with_one_line, outcome_of_module

Config = TypeVar("Config")


def run_as_process(config_type: type[Config], main: Callable[[Config], Any]) -> None:
    """Be a command: a `main` whose configuration's fields are the options."""
    with exit_with_one_line(answer_signals=False):
        main(tyro.cli(config_type))


def run_module(module: str, *arguments: str) -> None:
    """Run `python -m module arguments`; a child that failed has said why, so pass on its status."""
    status, _ = outcome_of_module(module, *arguments, quiet=False)
    if status == -signal.SIGTERM:
        raise Terminated
    if status < 0:
        raise InterruptedWorkError(
            f"a process that the system ended with signal {-status}",
            "enough memory for it",
            "Free memory and run the same command: it goes on where it was.",
        )
    if status:
        sys.exit(status)


def run_dsnet(command: str, *arguments: str) -> None:
    run_module("dsnet.cli", command, *arguments)
