"""The command: one line and status 2 for a mistake, help for every subcommand."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from bridge.cli import COMMANDS, main

SHOW_HELPS = """
import contextlib, io, json
from bridge.cli import COMMANDS, main
shown = {}
for command in COMMANDS:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):
        main([command, "--help"])
    shown[command] = out.getvalue()
print(json.dumps(shown))
"""
FOLDERS_AND_FILES = ("pack", "unpack")
"""Commands for anybody's artifacts, not for those of a run."""


def test_every_command_has_help(capsys):
    main(["--help"])
    overview = capsys.readouterr().out
    assert all(f"  {command} " in overview for command in COMMANDS)


@pytest.fixture(scope="module")
def helps() -> dict[str, str]:
    """What every command's --help shows; one process, as loading the frameworks takes seconds."""
    done = subprocess.run(
        [sys.executable, "-c", SHOW_HELPS], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_run_and_seed(command, helps):
    assert ("--run" in helps[command]) == (command not in FOLDERS_AND_FILES)
    assert "--seed" in helps[command]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly"], "expected one of corpus"),
        (["report", "--profile", "huge"], "expected one of smoke"),
        (["plan", "--profile", "huge"], "expected one of smoke"),
        (["plan", "--run", "../up"], "plain folder name"),
        (["plan", "--dyna", "x.h5"], "one of --smpl and --dyna"),
        (["report", "--run", "no-such-run"], "unknown run 'no-such-run'"),
        (["report", "--run", "../up"], "plain folder name"),
        (["predict", "--motion", "x.npz"], "--out"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    printed = capsys.readouterr().err
    assert stopped.value.code == 2
    assert words in printed
    assert printed.count("\n") == 1
    assert "Traceback" not in printed
    assert not list(tmp_path.iterdir())
