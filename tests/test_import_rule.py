"""The two frameworks never meet in one process, and the bridge needs neither."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "bridge": {"torch", "tensorflow", "keras"},
    "torch_align_ae": {"tensorflow", "keras", "tf_dsnet"},
    "tf_dsnet": {"torch", "torch_align_ae"},
}


def imported_packages(path: Path, *, module_level_only: bool) -> set[str]:
    tree = ast.parse(path.read_text())
    nodes = tree.body if module_level_only else ast.walk(tree)
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names


@pytest.mark.parametrize("package", FORBIDDEN)
def test_no_source_file_imports_the_other_side(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        found = imported_packages(path, module_level_only=package == "bridge")
        assert not found & FORBIDDEN[package], path


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("bridge.cli", "torch tensorflow keras"),
        ("bridge.exchange", "torch tensorflow keras"),
        ("bridge.runtime.stage_predict", "torch tensorflow keras"),
        ("torch_align_ae", "tensorflow keras"),
        ("tf_dsnet", "torch"),
    ],
)
def test_importing_loads_only_its_own_framework(module, absent):
    code = f"import sys, {module}; sys.exit(bool(set({absent.split()!r}) & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)
