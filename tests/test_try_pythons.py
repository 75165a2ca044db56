"""Other Pythons: what is missing is said, what fails fails."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tools import try_pythons


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


def test_a_command_that_hangs_has_failed():
    done = try_pythons.run([sys.executable, "-c", "import time; time.sleep(60)"], timeout=0.1)
    assert done.returncode == 124
