"""README's Python blocks run as they stand, on a real run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.pages import python_blocks

BLOCKS = python_blocks("README.md")
# What must hold after each.
HOLDS = (
    "assert vertices_m.shape == offsets_m.shape == (len(motion.theta), 6890, 3)",
    "assert moved.vertices_m.shape == moved.offsets_m.shape == (6890, 3)",
)


@pytest.mark.parametrize(("block", "holds"), [*zip(BLOCKS, HOLDS, strict=True)])
@pytest.mark.parametrize("model", ["", pytest.param('"smoke", ', marks=pytest.mark.slow)])
def test_the_readmes_python_works(
    request, tmp_path: Path, execute, block: str, holds: str, model: str
) -> None:
    """With the package's model, and with a run's."""
    runs = request.getfixturevalue("smoke_runs") if model else tmp_path
    code = block.replace("Stream(", f"Stream({model}").replace("(motion, ", f"(motion, {model}")
    done = execute([sys.executable, "-W", "error", "-c", f"{code}\n{holds}"], runs)
    assert done.returncode == 0, done.stderr
