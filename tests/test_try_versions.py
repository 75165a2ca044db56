"""Other Pythons and the oldest frameworks: what is missing is said, what fails fails."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tools import try_oldest, try_pythons


def test_an_interpreter_is_found_by_what_it_says_of_itself(monkeypatch, tmp_path: Path):
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    place = tmp_path / "versions" / "3.99.1" / "bin" / "python"
    place.parent.mkdir(parents=True)
    place.write_text("#!/bin/sh\necho pyenv: not installed\nexit 127\n")
    place.chmod(0o755)
    assert try_pythons.find_python("3.99") is None
    place.write_text("#!/bin/sh\necho 3.99\n")
    assert try_pythons.find_python("3.99") == str(place)


@pytest.mark.parametrize(
    ("failing", "fine", "said"),
    [
        ("--constraint", True, "its packages cannot be had: no wheel for x"),
        ("--no-deps", False, "install failed"),
        ("predict", False, "predict failed"),
        ("export", False, "export failed"),
        ("pytest", False, "tests failed"),
        ("nothing", True, "installed, predicts, exports; 5 passed"),
    ],
)
def test_only_what_others_lack_is_an_excuse(failing, fine, said, monkeypatch, capsys, tmp_path):
    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        bad = failing in command and ("--constraint" in command) == (failing == "--constraint")
        return subprocess.CompletedProcess(command, int(bad), "5 passed", "\nno wheel for x" * bad)

    monkeypatch.setattr(try_pythons, "run", run)
    monkeypatch.setattr(try_pythons, "asked_by", lambda wheel: ["numpy", "torch; extra == 'train'"])
    assert try_pythons.works("3.99", sys.executable, tmp_path / "x.whl", tmp_path) == fine
    assert said in capsys.readouterr().out


def test_the_oldest_are_those_of_the_extra_and_not_newer_than_the_pinned():
    oldest = try_oldest.oldest_frameworks((try_oldest.ROOT / "pyproject.toml").read_text())
    pinned = (try_oldest.ROOT / "constraints.txt").read_text()
    assert len(oldest) == 2
    for line in oldest:
        name, _, version = line.partition("==")
        (newest,) = re.findall(rf"^{name}==([\d.]+)", pinned, re.MULTILINE)
        assert [*map(int, version.split("."))] <= [*map(int, newest.split("."))]


@pytest.mark.parametrize(
    ("failing", "error", "fine", "said"),
    [
        (
            "install",
            "no wheel for x",
            True,
            "not tried, for packages cannot be had: no wheel for x",
        ),
        ("install", "ERROR: ResolutionImpossible: x", False, "exclude one another"),
        ("no:cacheprovider", "1 failed", False, "tests failed"),
        ("nothing", "", True, "keras==3.5: 5 passed"),
    ],
)
def test_only_what_cannot_be_had_is_an_excuse(
    failing, error, fine, said, monkeypatch, capsys, tmp_path
):
    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        bad = failing in command
        return subprocess.CompletedProcess(command, int(bad), "5 passed", f"\n{error}" * bad)

    monkeypatch.setattr(try_oldest, "run", run)
    assert try_oldest.works(["keras==3.5"], ["numpy"], ["tests"], tmp_path) == fine
    assert said in capsys.readouterr().out
