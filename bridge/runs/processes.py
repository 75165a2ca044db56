"""Stages run as processes, a framework in each; arrays pass on disk, never in memory.

A process that was started here ends with the one that started it, however that ends.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import tyro

from bridge.endings import (
    Terminated,
    exit_with_one_line,
    ignore_interrupts,
    interrupts_withheld,
)
from bridge.errors import InterruptedWorkError, printable
from bridge.installation import require_packages_of

Config = TypeVar("Config")
_BEGIN = "from bridge.runs.processes import end_with_parent; end_with_parent();"
_MODULE = "import runpy; runpy.run_module({!r}, run_name='__main__', alter_sys=True)"
_DSNET = "from bridge.cli import main; main()"


def run_module(module: str, *arguments: str) -> None:
    """Run `python -m module arguments`; a child that failed has said why, so pass on its status.

    Raises
    ------
    SystemExit
        With the child's exit status when it is not 0.
    """
    require_packages_of(module)
    _run(_MODULE.format(module), arguments)


def run_dsnet(command: str, *arguments: str) -> None:
    """Run `dsnet command arguments` in a process of its own.

    Raises
    ------
    SystemExit
        With its exit status when it is not 0; it has said why.
    """
    _run(_DSNET, (command, *arguments))


def _run(code: str, arguments: Sequence[str]) -> None:
    with _begun(code, arguments) as child:
        child.wait()
    status = child.returncode
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


def outcome_of_module(module: str, *arguments: str) -> tuple[int, str]:
    """Exit status and stderr of `python -m module arguments`, which prints nothing of its own."""
    devnull, pipe = subprocess.DEVNULL, subprocess.PIPE
    with _begun(_MODULE.format(module), arguments, stdout=devnull, stderr=pipe) as child:
        _, said = child.communicate()
    return child.returncode, said


@contextmanager
def _begun(
    code: str, arguments: Sequence[str], stdout: int | None = None, stderr: int | None = None
) -> Iterator[subprocess.Popen[str]]:
    """A process that is ended if the block is left by an exception, or this process ends."""
    command = [sys.executable, "-c", _BEGIN + code, *arguments]
    reading, writing = os.pipe()
    try:
        with interrupts_withheld():
            child = subprocess.Popen(
                command, stdin=reading, stdout=stdout, stderr=stderr, encoding="locale"
            )
        try:
            yield child
        except BaseException:
            child.kill()
            raise
        finally:
            child.wait()
    finally:
        os.close(reading)
        os.close(writing)


def end_with_parent() -> None:
    """End this process, begun by the above, when its parent does: nobody waits for it any more."""
    ignore_interrupts()

    def watch() -> None:
        # A pipe of which the parent holds the other end, and into which it writes nothing.
        os.read(0, 1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_as_process(config_type: type[Config], main: Callable[[Config], Any]) -> None:
    """The other end of `run_module`: a `main` whose configuration's fields are the options."""
    with exit_with_one_line(answer_signals=False):
        main(tyro.cli(config_type))


def notify(text: str) -> None:
    """One line on stderr about something that a user would want to know but need not mend."""
    print(f"dsnet: {printable(text)}", file=sys.stderr)  # noqa: T201
