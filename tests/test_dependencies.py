"""What the packages import is what pyproject.toml says that they need."""

from __future__ import annotations

import re
import subprocess
import sys

from tests.sources import PACKAGES, ROOT, imported_modules, source_files

PROVIDES = {
    "imageio-ffmpeg": "imageio_ffmpeg",
    "markdown-it-py": "markdown_it",
    "pillow": "PIL",
    "tensorflow-cpu": "tensorflow",
    "usd-core": "pxr",
}
# `alembic3d` brings Imath's arrays.
COMES_WITH = {"imath": "alembic3d"}
# In Blender, where the extension runs, and nowhere else.
BLENDERS_OWN = "bpy"


TEXTS = {"", ".cff", ".html", ".md", ".py", ".sh", ".toml", ".txt"}
FRAMEWORKS = {"h5py", "keras", "tensorflow", "torch"}
# What one format of `dsnet export` needs, or one command.
OF_ONE_COMMAND = ("usd", "abc", "clip", "fbx", "ray")
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
    foreign = modules - set(PACKAGES) - sys.stdlib_module_names - {BLENDERS_OWN}
    return {COMES_WITH.get(name, name) for name in foreign}


def test_dependencies_are_those_that_the_product_imports() -> None:
    assert imported(*PACKAGES) == needed().union(*map(extra, EXTRAS))


def test_an_installation_without_extras_has_what_prediction_needs_and_no_framework() -> None:
    brought = needed().union(*map(extra, OF_ONE_COMMAND))
    assert imported("bridge", "dsnet") == brought | {"h5py"}  # meshes, which only training needs
    assert not needed() & set().union(*map(extra, EXTRAS))
    assert not needed() & FRAMEWORKS
    assert extra("train") == extra("train-cpu") == FRAMEWORKS


def test_both_builds_of_tensorflow_are_the_same_version() -> None:
    pins = (ROOT / "constraints.txt").read_text()
    assert len(set(re.findall(r"^tensorflow(?:-cpu)?(==.*)$", pins, re.MULTILINE))) == 1
    assert "\ntensorflow-cpu==" in pins


def test_no_pip_command_names_what_is_not_a_dependency() -> None:
    """Ours is on no index: a name there like ours is somebody else's."""
    stated = (ROOT / "pyproject.toml").read_text() + (ROOT / "constraints.txt").read_text()
    known = set(re.findall(r'^[\s"]*([\w-]+)[=>]=', stated, re.MULTILINE)) | {"anny"}
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    named = {
        (name, file)
        for file in files.stdout.splitlines()
        if file != "tests/test_dependencies.py" and (ROOT / file).suffix in TEXTS
        for name in installed_by((ROOT / file).read_text(encoding="utf-8"))
    }
    assert {"torch", "anny"} <= {name for name, _ in named}
    assert not {(name, file) for name, file in named if name not in known}


def installed_by(text: str) -> set[str]:
    """Distributions of an index that `pip install` commands in a text name."""
    commands = re.findall(r"""pip install((?: +(?:"[^"\n]*"|[^\s"'`#)]+))+)""", text)
    words = {word for command in commands for word in re.findall(r'"[^"]*"|\S+', command)}
    names = {re.sub(r"\[.*\]|[=<>!~].*|[.,;:]+$", "", word.strip('"')) for word in words}
    return {name for name in names if re.fullmatch(r"[A-Za-z][\w.-]*", name)}
