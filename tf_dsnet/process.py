"""A module of this package as a process that another stage starts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, TypeVar

import tyro

from bridge.errors import DsnetError

Config = TypeVar("Config")


def run_as_process(config_type: type[Config], main: Callable[[Config], Any]) -> None:
    """Read the configuration from the command line; one line and status 2 for a user's mistake."""
    try:
        main(tyro.cli(config_type))
    except DsnetError as error:
        sys.stderr.write(f"dsnet: {error}\n")
        sys.exit(2)
