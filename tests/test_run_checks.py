"""A check runs when what it looks at has changed, and is remembered when it has passed."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tools import run_checks
from tools.run_checks import CHECKS, Check, digest_of, files_of


@pytest.fixture
def tree(monkeypatch, tmp_path: Path) -> Path:
    """A package of three modules, of which one test imports one that imports another."""
    files = {
        "shop/__init__.py": "",
        "shop/till.py": "from shop.coins import COINS",
        "shop/coins.py": "COINS = 1, 2",
        "shop/window.py": "",
        "shop/prices.json": "{}",
        "tests/test_till.py": "def test():\n    from shop import till\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / ".ci").mkdir()
    monkeypatch.setattr(run_checks, "ROOT", tmp_path)
    monkeypatch.setattr(run_checks, "PASSED", tmp_path / ".ci" / "passed.json")
    monkeypatch.setattr(run_checks, "tracked", lambda: frozenset(files))
    run_checks.imported_by.cache_clear()
    return tmp_path


def test_a_checks_files_are_what_it_imports_and_what_lies_beside(tree: Path) -> None:
    found = files_of(Check("true", ("tests/test_till.py",)))
    beside = {"shop/__init__.py", "shop/till.py", "shop/coins.py", "shop/prices.json"}
    assert found == {"tests/test_till.py"} | beside


@pytest.mark.parametrize(("changed", "again"), [("shop/coins.py", True), ("shop/window.py", False)])
def test_it_runs_again_when_one_of_them_has_changed(
    tree: Path, monkeypatch, changed: str, again: bool
) -> None:
    monkeypatch.setattr(run_checks, "CHECKS", {"till": Check("echo >> ran", ("tests",))})
    monkeypatch.setattr(sys, "argv", ["run_checks"])
    assert run_checks.main() == run_checks.main() == 0
    assert (tree / "ran").read_text() == "\n"
    (tree / changed).write_text("COINS = 1, 2, 5")
    assert run_checks.main() == 0
    assert len((tree / "ran").read_text()) == 1 + again


def test_one_that_fails_fails_the_command_and_is_not_remembered(tree: Path, monkeypatch) -> None:
    bad, good = Check("exit 3", ("tests",)), Check("true", ("tests",))
    monkeypatch.setattr(run_checks, "CHECKS", {"bad": bad, "good": good})
    monkeypatch.setattr(sys, "argv", ["run_checks"])
    assert run_checks.main() == 1
    assert json.loads((tree / ".ci" / "passed.json").read_text()) == {"good": digest_of(good)}


def test_every_check_begins_somewhere() -> None:
    tracked = run_checks.tracked()
    for check in CHECKS.values():
        for start in check.begins:
            assert any(path == start or path.startswith(f"{start}/") for path in tracked), start
