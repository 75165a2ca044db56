"""Commands as a user gives them, for every test in this folder."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.smoke_run import execute as execute_at_root

Execute = Callable[[list[str], Path], "subprocess.CompletedProcess[str]"]


@pytest.fixture
def execute() -> Execute:
    """Run a command at the repository's root with a given folder in place of `runs/`."""
    return execute_at_root
