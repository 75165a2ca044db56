"""Run the checks that few changes can break: other Pythons, Blender, browsers, a cluster, faults.

    python -m tools.run_checks          those whose files have changed since they last passed
    python -m tools.run_checks --all    every one: before a release

The files of a check are its own, all that they import (functions' imports included), and what lies
beside these, such as the viewer's page. What a check begins as another process is not followed:
`--all` is for that. `.ci/passed.json` says which files each check last passed with; commit it.
"""

from __future__ import annotations

import ast
import hashlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from bridge.runs.files import write_text_atomically
from tools.try_pythons import TESTS

ROOT = Path(__file__).resolve().parents[1]
PASSED = ROOT / ".ci" / "passed.json"
FOR_ALL = ("pyproject.toml", "constraints.txt")
_PYTEST = f"{sys.executable} -m pytest"


@dataclass(frozen=True)
class Check:
    """A shell command, and the files and folders where it begins."""

    command: str
    begins: tuple[str, ...]


CHECKS = {
    "pythons": Check(f"{sys.executable} -m tools.try_pythons", ("tools/try_pythons.py", *TESTS)),
    "blender": Check(
        f"{sys.executable} -m tools.try_blender", ("tools/try_blender.py", "docs/export.md")
    ),
    "browsers": Check(
        f".ci/install_browsers; {_PYTEST} -m browser tests/dsnet/view", ("tests/dsnet/view",)
    ),
    "cluster": Check(
        f"{_PYTEST} -m cluster tests/cluster tests/bridge/runs/test_workers.py",
        ("tests/cluster", "tests/bridge/runs/test_workers.py"),
    ),
    "faults": Check(f"{_PYTEST} -n 2 -m faults tests/faults", ("tests/faults",)),
    "fuzz": Check(f"{_PYTEST} -n 2 -m fuzz tests/fuzz", ("tests/fuzz",)),
}


def main() -> int:
    """Run them; 1 if one fails."""
    passed: dict[str, str] = (
        json.loads(PASSED.read_text(encoding="utf-8")) if PASSED.exists() else {}
    )
    failed = False
    for name, check in CHECKS.items():
        digest = digest_of(check)
        if passed.get(name) == digest and "--all" not in sys.argv[1:]:
            print(f"check {name}: its files have not changed since it passed", flush=True)
            continue
        began = time.monotonic()
        status = subprocess.run(check.command, shell=True, cwd=ROOT, check=False).returncode
        seconds = time.monotonic() - began
        print(f"check {name}: {'failed' if status else 'passed'}, {seconds:.0f} s", flush=True)
        failed = failed or status != 0
        if not status:
            passed[name] = digest
            write_text_atomically(PASSED, json.dumps(passed, indent=1) + "\n")
    return int(failed)


def digest_of(check: Check) -> str:
    """SHA-256 of the paths and bytes of all files of a check."""
    digest = hashlib.sha256(check.command.replace(sys.executable, "python").encode())
    for path in sorted(files_of(check)):
        digest.update(
            f"{path}\0{hashlib.sha256((ROOT / path).read_bytes()).hexdigest()}\n".encode()
        )
    return digest.hexdigest()


def files_of(check: Check) -> set[str]:
    """Paths from the repository's root."""
    begins = {path for start in (*check.begins, *FOR_ALL) for path in _below(start)}
    files, new = set(begins), begins
    while new:
        new = {found for path in new if path.endswith(".py") for found in imported_by(path)} - files
        files |= new
    packages = {path.rpartition("/")[0] for path in files if path.endswith("/__init__.py")}
    return files | {
        path for path in tracked() if _package_of(path) in packages and path[-3:] != ".py"
    }


@cache
def tracked() -> frozenset[str]:
    """Files of the repository."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return frozenset(path for path in listed.stdout.split("\0") if path)


def _below(start: str) -> Iterator[str]:
    yield from (path for path in tracked() if path == start or path.startswith(f"{start}/"))


def _package_of(path: str) -> str:
    """The innermost package that a file lies in, or below."""
    folder = path.rpartition("/")[0]
    while folder and f"{folder}/__init__.py" not in tracked():
        folder = folder.rpartition("/")[0]
    return folder


@cache
def imported_by(path: str) -> frozenset[str]:
    """Files that a file imports when it runs: those for type checkers alone are left out."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    files = {file for node in _running(tree) for name in _names(node) for file in _files(name)}
    return frozenset(files & tracked())


def _files(name: str) -> Iterator[str]:
    """Where a module may be, a name that it holds, and the packages around it."""
    parts = name.split(".")
    for end in range(1, len(parts) + 1):
        stem = "/".join(parts[:end])
        yield from (f"{stem}.py", f"{stem}/__init__.py")


def _running(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from _running(child)


def _names(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module:
        yield from (f"{node.module}.{alias.name}" for alias in node.names)


if __name__ == "__main__":
    raise SystemExit(main())
