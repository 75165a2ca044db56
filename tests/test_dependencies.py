"""What the packages import is what pyproject.toml says that they need."""

from __future__ import annotations

import re
import sys

from tests.sources import PACKAGES, ROOT, imported_modules, source_files

PROVIDES = {"markdown-it-py": "markdown_it"}
# Keras comes with TensorFlow, which fixes its version.
COMES_WITH = {"keras": "tensorflow"}


def needed() -> set[str]:
    """Packages that an installation without extras brings."""
    text = (ROOT / "pyproject.toml").read_text()
    listed = text.split("\ndependencies = [\n")[1].split("\n]")[0]
    names = re.findall(r'"([\w-]+)', listed)
    return {PROVIDES.get(str(name), str(name)) for name in names}


def test_runtime_dependencies_are_those_that_the_product_imports() -> None:
    modules = {
        name.partition(".")[0] for p in source_files(*PACKAGES) for name in imported_modules(p)
    }
    foreign = modules - set(PACKAGES) - sys.stdlib_module_names
    assert {COMES_WITH.get(name, name) for name in foreign} == needed()
