"""What the packages import is what pyproject.toml says that they need."""

from __future__ import annotations

import re
import sys

from tests.sources import PACKAGES, ROOT, imported_modules, source_files

PROVIDES = {
    "imageio-ffmpeg": "imageio_ffmpeg",
    "markdown-it-py": "markdown_it",
    "pillow": "PIL",
    "usd-core": "pxr",
}
# Keras comes with TensorFlow, which fixes its version.
COMES_WITH = {"keras": "tensorflow"}


FRAMEWORKS = {"h5py", "tensorflow", "torch"}
# What one format of `dsnet export` needs, or one command.
OF_ONE_COMMAND = ("usd", "clip", "viewer", "ray")
EXTRAS = ("train", *OF_ONE_COMMAND)


def needed(listed: str = "\ndependencies = [\n") -> set[str]:
    """Packages that an installation brings: without extras, or those of the list that begins so."""
    text = (ROOT / "pyproject.toml").read_text().split(listed)[1].split("\n]")[0]
    names = re.findall(r'"([\w-]+)', text)
    return {PROVIDES.get(str(name), str(name)) for name in names}


def extra(name: str) -> set[str]:
    """Packages that an extra brings."""
    return needed(f"\n{name} = [\n")


def imported(*packages: str) -> set[str]:
    """Packages that these packages import and do not bring themselves."""
    modules = {
        name.partition(".")[0] for p in source_files(*packages) for name in imported_modules(p)
    }
    foreign = modules - set(PACKAGES) - sys.stdlib_module_names
    return {COMES_WITH.get(name, name) for name in foreign}


def test_dependencies_are_those_that_the_product_imports() -> None:
    assert imported(*PACKAGES) == needed().union(*map(extra, EXTRAS))


def test_an_installation_without_extras_has_what_prediction_needs_and_no_framework() -> None:
    assert imported("bridge") == needed().union(*map(extra, OF_ONE_COMMAND))
    assert not needed() & set().union(*map(extra, EXTRAS))
    assert not needed() & FRAMEWORKS
    assert extra("train") == FRAMEWORKS
