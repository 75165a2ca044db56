"""Completion scripts: what a shell offers at the first word and after it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from dsnet.cli import COMMANDS, SHELLS
from tests.dsnet.test_cli import options_of, without_frameworks

BASH = shutil.which("bash") or ""
# As bash does when the tab key is pressed at the end of the last word.
PRESS_TAB = r"""
compopt() { echo "compopt $*"; }
source "$0"
[[ $(complete -p dsnet) =~ -F\ ([^ ]+) ]]
COMP_WORDS=(dsnet "$@") COMP_CWORD=$#
${BASH_REMATCH[1]}
((${#COMPREPLY[@]} == 0)) || printf '%s\n' "${COMPREPLY[@]}"
"""
needs_bash = pytest.mark.skipif(not BASH, reason="bash is not installed")


@pytest.fixture(scope="module", params=SHELLS)
def script(request: pytest.FixtureRequest) -> str:
    return without_frameworks("--completion", request.param)


@pytest.fixture(scope="module")
def bash_script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "dsnet"
    path.write_text(without_frameworks("--completion", "bash"), encoding="utf-8")
    return path


def offered(script: Path, *words: str) -> set[str]:
    """What bash offers for the last of the words after `dsnet`."""
    done = subprocess.run(
        [BASH, "--norc", "--noprofile", "-c", PRESS_TAB, str(script), *words],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert not done.stderr
    return {*done.stdout.splitlines()}


def test_a_script_is_of_this_program_and_its_commands(script: str) -> None:
    assert "dsnet" in script
    assert not [command for command in COMMANDS if f"'{command}'" not in script]


@needs_bash
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["pre"], {"predict"}),
        (["predict", "--mot"], {"--motion", "--motion-fps"}),
        (["export", "--to", "usd", "--prec"], {"--precision"}),
        (["train", "--engine", ""], {"local", "ray"}),
        (["report", "--profile", "d"], {"demo"}),
        (["predict", "--nothing"], set()),
    ],
)
def test_bash_completes(words: list[str], expected: set[str], bash_script: Path) -> None:
    assert offered(bash_script, *words) == expected


@needs_bash
@pytest.mark.parametrize("command", ["predict", "evaluate"])
def test_bash_offers_the_options_of_the_help(command: str, bash_script: Path) -> None:
    options = offered(bash_script, command, "--") - {"--no-loop"}
    assert options == options_of(without_frameworks(command, "--help")) | {"--help"}
    assert {*COMMANDS} <= offered(bash_script, "")


@needs_bash
def test_bash_completes_paths(bash_script: Path, tmp_path: Path) -> None:
    (tmp_path / "walk").mkdir()
    (tmp_path / "walk.npz").touch()
    paths = {str(tmp_path / "walk"), str(tmp_path / "walk.npz")}
    as_paths = {"compopt -o filenames"}  # after a folder's name comes a slash
    assert offered(bash_script, "view", "--motion", str(tmp_path / "wa")) == paths | as_paths
