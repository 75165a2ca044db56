"""Stages run as processes: how one is started, and how one ends when a user made a mistake.

Each framework has a process of its own; arrays pass on disk, never in memory.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import tyro

from bridge.errors import DsnetError, printable

Config = TypeVar("Config")
_FRAMEWORKS = {"torch_align_ae": ("torch", "h5py"), "tf_dsnet": ("tensorflow",)}
"""What the extra `train` brings for each package."""


def require_packages_of(module: str) -> None:
    """Make sure that the framework of a module's package is installed.

    Raises
    ------
    DsnetError
        If it is not: an installation without the extra `train` predicts, shows and exports.
    """
    for framework in _FRAMEWORKS.get(module.partition(".")[0], ()):
        if importlib.util.find_spec(framework) is None:
            raise DsnetError(
                f"an installation without {framework}",
                f"{framework}, which {module} needs",
                'Install the extra: pip install "dsnet[train]".',
            )


def run_module(module: str, *arguments: str) -> None:
    """Run `python -m module arguments`; a child that failed has said why, so pass on its status.

    Raises
    ------
    SystemExit
        With the child's exit status when it is not 0.
    """
    require_packages_of(module)
    _run("-m", module, *arguments)


def run_dsnet(command: str, *arguments: str) -> None:
    """Run `dsnet command arguments` in a process of its own.

    Raises
    ------
    SystemExit
        With its exit status when it is not 0; it has said why.
    """
    _run("-c", "from bridge.cli import main; main()", command, *arguments)


def _run(*arguments: str) -> None:
    status = subprocess.run([sys.executable, *arguments], check=False).returncode
    if status:
        sys.exit(status)


def answer_of_module(module: str, *arguments: str) -> str:
    """What `python -m module arguments` prints; a child that failed has said why.

    Raises
    ------
    SystemExit
        With the child's exit status when it is not 0.
    """
    require_packages_of(module)
    command = [sys.executable, "-m", module, *arguments]
    child = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if child.returncode:
        sys.exit(child.returncode)
    return child.stdout


def run_as_process(config_type: type[Config], main: Callable[[Config], Any]) -> None:
    """The other end of `run_module`: a `main` whose configuration's fields are the options."""
    with exit_with_one_line():
        main(tyro.cli(config_type))


def notify(text: str) -> None:
    """One line on stderr about something that a user would want to know but need not mend."""
    print(f"dsnet: {printable(text)}", file=sys.stderr)  # noqa: T201


@contextmanager
def exit_with_one_line() -> Iterator[None]:
    """Turn a DsnetError into one line and exit status 2, an interrupt into one line and 130."""
    try:
        yield
    except DsnetError as error:
        print(f"dsnet: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(2)
    except KeyboardInterrupt:
        print("dsnet: interrupted; run the same command to go on", file=sys.stderr)  # noqa: T201
        sys.exit(130)
