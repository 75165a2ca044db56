"""README's Python blocks run as they stand, on a real run."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
# What a block takes as given, and what must hold after it; a block without an entry fails.
GIVEN = {
    "tf_dsnet": """
import numpy
theta, betas = numpy.zeros((2, 69), numpy.float32), numpy.zeros((2, 10), numpy.float32)
""",
    "torch_align_ae": """
import torch
betas, pose, trans = torch.full((2, 10), 0.5), torch.full((2, 22, 3), 0.1), torch.ones(2, 3)
offsets = torch.full((2, 6890, 3), 0.01)
""",
}
HOLDS = {
    "tf_dsnet": """
assert moved.vertices_m.shape == (6890, 3)
assert latents.shape == (2, 100) and numpy.isfinite(latents).all()
""",
    "torch_align_ae": """
assert vertices.shape == (2, 6890, 3)
torch.testing.assert_close(rest, smpl.rest_vertices(betas, pose) + offsets, atol=1e-5, rtol=0)
""",
}


def test_readme_has_blocks() -> None:
    assert len(BLOCKS) >= 2


@pytest.mark.parametrize("block", BLOCKS)
def test_the_readmes_python_works(smoke_runs, execute, block: str) -> None:
    package = block.split()[1]
    code = GIVEN[package] + block.replace('"demo"', '"smoke"') + HOLDS[package]
    done = execute([sys.executable, "-W", "error", "-c", code], smoke_runs)
    assert done.returncode == 0, done.stderr
