"""The command: one line and status 2 for a mistake, help for every subcommand."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dsnet.cli import COMMANDS, main
from dsnet.report import stage_report
from tests.pages import PAGES, commands_on, flags_of

COMMON = {"--profile", "--engine", "--address", "--seed", "--help"}
"""Options of every command."""
SHOW_HELPS = """
import contextlib, io, json
from dsnet.cli import COMMANDS, main
shown = {}
for command in COMMANDS:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):
        main([command, "--help"])
    shown[command] = out.getvalue()
print(json.dumps(shown))
"""


@pytest.fixture(scope="module")
def helps() -> dict[str, str]:
    """What every command's --help shows; one process, as loading the frameworks takes seconds."""
    done = subprocess.run(
        [sys.executable, "-c", SHOW_HELPS], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def test_commands_and_options_are_few(helps: dict[str, str]) -> None:
    own = {command: options_of(text) - COMMON for command, text in helps.items()}
    assert all("--run" in options for options in own.values())
    assert len(COMMANDS) <= 14
    assert sum(map(len, own.values())) <= 111, own


def options_of(text: str) -> set[str]:
    """The options that a help explains."""
    return set(re.findall(r"^\W*(--[a-z][a-z-]*)", text, re.MULTILINE))


@pytest.mark.parametrize("command", COMMANDS)
def test_a_help_explains_the_common_options(command, helps):
    """But for a profile where it changes nothing."""
    assert COMMON - options_of(helps[command]) <= {"--help", "--profile"}
    assert re.search(r"--engine .*local.*ray", helps[command])


@pytest.mark.parametrize(
    ("spelling", "option"),
    [("-V", "--version"), ("version", "--version"), ("", "--help"), ("-h", "--help"),
     ("help", "--help")],
)  # fmt: skip
def test_versions_and_the_overview_have_several_spellings(spelling, option, capsys):
    main([option])
    expected = capsys.readouterr().out
    main(spelling.split())
    assert capsys.readouterr().out == expected
    listed = re.findall(r"^  ([a-z-]+) ", expected, re.MULTILINE)
    assert sorted(listed) == (sorted(COMMANDS) if option == "--help" else [])


def test_help_of_a_command_is_that_of_its_option(helps, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["help", "check"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out == helps["check"]


def test_what_only_studies_set_is_no_option(capsys):
    assert "--stop-epoch of dsnet train-ae" in refused(["train-ae", "--stop-epoch", "3"], capsys)


def test_a_study_sets_what_is_no_option(monkeypatch):
    made = []
    monkeypatch.setattr(stage_report, "main", made.append)
    main(["report", "--run", "r"], panel_px=60)
    assert made == [stage_report.ReportConfig(run="r", panel_px=60)]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly"], "expected one of corpus"),
        (["help", "fly"], "expected one of corpus"),
        (["--completion"], "expected one of bash"),
        (["--completion", "powershell"], "expected one of bash"),
        (["report", "--profile", "huge"], "expected one of smoke"),
        (["report", "--profile=smoke", "--profile", "huge"], "expected one of smoke"),
        (["report", "--profile"], "expected one of smoke"),
        (["report", "--seed", "-1"], "expected 0 to"),
        (["report", "--run", "no-such-run"], "unknown run 'no-such-run'"),
        (["report", "--run", "../up"], "plain folder name"),
        (["predict", "--motion", "x.npz"], "--out"),
        (["report", "--run", "x" * 300], "File name too long; expected names of at most 255"),
        (["export", "--to", "npz", "--motion", "sample:walking", "--out", "."], "of its own"),
        (["predict", "--motion", "sample:walking", "--out", ""], "of its own"),
        (["predict", "--motion", ".", "--out", "o", "--person", "2"], "--person with ., a folder"),
        (["predict", "--motion", "sample:walking", "--out", "o", "--person", "2"], "one person"),
        (["predict", "--motion", "sample:walking", "--out", "o", "--person", "0"], "1 or more"),
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


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("predcit", "predict"),
        ("report --profile dmeo", "demo"),
        ("report --run wlak", "walk"),
        ("export --to ussd --motion sample:walking --out {tmp}/o", "usd"),
        ("export --to USD --motion sample:walking --out {tmp}/o", "usd"),
        ("export --to pc2 --motion wlaking --out {tmp}/o", "sample:walking"),
        ("predict --motion sample:walkin --out {tmp}/o", "sample:walking"),
        ("predict --motion walking --out {tmp}/o", "sample:walking"),
        ("predict --motion sample:walking --predictor dsnet_pluss --out {tmp}/o", "dsnet_plus"),
        ("predict --motion sample:walking --part-gain bely=2 --out {tmp}/o", "belly"),
        ("predict --motion sample:walking --shape havy --out {tmp}/o", "heavy"),
        ("predict --motion sample:walking --shape heigth=182 --out {tmp}/o", "height"),
        ("corpus --motions hipz --run new", "hips"),
    ],
)
def test_the_nearest_name_is_offered(line, meant, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    (tmp_path / "walk" / "align").mkdir(parents=True)
    (tmp_path / "walk" / "align" / "manifest.json").touch()
    printed = refused(line.format(tmp=tmp_path).split(), capsys)
    assert f"Did you mean {meant!r}?" in printed
    assert printed.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--motoin x", "--motoin of dsnet predict, unknown; expected one of its options. Did you"),
        ("--part_gian x", "Did you mean '--part-gain'? See dsnet predict --help."),
        ("--no-lop", "Did you mean '--no-loop'?"),
        ("--smooth-hz atuo", "expected auto or a number. Did you mean 'auto'?"),
        ("--gain much", "--gain much; expected a number. Pass --gain N."),
        ("--gain=2,5", "--gain 2,5; expected a number. Pass --gain N."),
        ("--seed 1.5", "--seed 1.5; expected a whole number."),
        ("--gender fem", "expected female, male, neutral. Did you mean 'female'?"),
        ("--engine rya", "Did you mean 'ray'?"),
        ("--motion a.npz --out", "--out without a value; expected PATH."),
        ("--gain --loop", "--gain without a value; expected FLOAT."),
    ],
)
def test_what_the_parser_cannot_read_is_one_line(line, words, capsys):
    printed = refused(["predict", *line.split()], capsys)
    assert words in printed
    assert printed.count("\n") == 1


def test_help_begins_with_what_is_required(helps):
    options = re.findall(r"^\W*(--[a-z][a-z-]*)", helps["predict"], re.MULTILINE)
    assert options[:4] == ["--motion", "--out", "--run", "--predictor"]
    assert helps["predict"].count("(required)") == 2
    assert not [text for text in helps.values() if "{None}" in text or "(default: None)" in text]


WITHOUT_FRAMEWORKS = """
import sys
from dsnet.cli import main
class Refused:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in ("tensorflow", "keras", "torch"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Refused())
main(sys.argv[1:])
"""


def without_frameworks(*arguments: str) -> str:
    """What the command prints where no framework is installed."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_FRAMEWORKS, *arguments],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("command", ["train", "predict", "export", "view", "corpus"])
def test_help_needs_no_framework(command):
    assert "--run" in without_frameworks(command, "--help")


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("predict a.npz out", "predict --motion a.npz --out out"),
        ("predict a.npz", "predict --motion a.npz"),
        ("predict a.npz out --gain 2", "predict --motion a.npz --out out --gain 2"),
        ("export a.npz b.USD", "export --to usd --motion a.npz --out b.USD"),
        ("export a.npz", "export --to usd --motion a.npz --out a.usdz"),
        ("export a.npz b --to obj", "export --motion a.npz --out b --to obj"),
        ("view a.npz", "view --motion a.npz"),
        ("report demo", "report --run demo"),
    ],
)
def test_words_without_a_name_are_told_theirs(line, meant, capsys):
    printed = refused(line.split(), capsys)
    assert printed.endswith(f". Run: dsnet {meant}\n")
    assert printed.count("\n") == 1


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    return capsys.readouterr().err


def test_commands_of_dsnet_on_pages_are_its_own(helps: dict[str, str]) -> None:
    lines = [line for page in PAGES for line in commands_on(page)]
    command = re.compile(r"(?:^|[/\s])dsnet ([a-z][a-z-]+)(.*)")
    found = [part for line in lines for part in command.findall(line)]
    assert len(found) > 40
    known = {command: COMMON | flags_of(text) for command, text in helps.items()}
    assert not [
        (name, flag) for name, rest in found for flag in flags_of(rest) - known.get(name, set())
    ]
    assert {name for name, _ in found} <= known.keys()


def dsnet(*arguments: str, python: tuple[str, ...] = (), **given) -> subprocess.CompletedProcess:
    code = "from dsnet.cli import main; main()"
    return subprocess.run(
        [sys.executable, *python, "-c", code, *arguments],
        stderr=subprocess.PIPE, text=True, check=False, timeout=60, **given,
    )  # fmt: skip


@pytest.mark.parametrize("python", [(), ("-u",)])
@pytest.mark.parametrize("arguments", [("--help",), ("check", "--help")])
def test_who_stops_reading_is_told_nothing(arguments, python):
    reading, writing = os.pipe()
    os.close(reading)
    done = dsnet(*arguments, python=python, stdout=writing)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no such device")
def test_output_that_has_no_room_is_one_line():
    with open("/dev/full", "w") as full:
        done = dsnet("--help", stdout=full)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "room on the disk" in done.stderr


def test_a_terminal_of_five_columns_has_a_help():
    done = dsnet("check", "--help", stdout=subprocess.PIPE, env={**os.environ, "COLUMNS": "5"})
    assert done.returncode == 0, done.stderr
    assert "--run" in done.stdout


def test_nothing_is_left_or_told_by_onnx_runtime(tmp_path):
    places = {**os.environ, "TMPDIR": str(tmp_path), "HOME": str(tmp_path)}
    places.pop("ORT_DISABLE_TELEMETRY", None)
    subprocess.run([sys.executable, "-c", "import bridge, onnxruntime"], check=True, env=places)
    assert not list(tmp_path.iterdir())
