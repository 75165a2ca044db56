"""`reproduce.sh` hands its options on, with paths as the caller means them; no stage is run."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# fmt: off
STAGES = [
    "corpus", "align", "train-ae", "encode", "train", "infer", "decode", "evaluate", "report",
]
FOR_RUNS = "train-cpu,usd,clip"
EVERYTHING = f"{FOR_RUNS},abc,fbx,ray,dev,docs"
# fmt: on

Reproduce = Callable[..., "subprocess.CompletedProcess[str]"]


def write_command(project: Path, name: str, script: str) -> None:
    """A command of the environment that does what `script` says."""
    path = project / ".venv" / "bin" / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.fixture
def reproduce(tmp_path: Path) -> Reproduce:
    """The script beside commands that print their arguments, called from a folder with files."""
    project, caller = tmp_path / "project", tmp_path / "caller"
    (project / ".venv" / "bin").mkdir(parents=True)
    (project / "tests" / "tf_dsnet").mkdir(parents=True)
    (caller / "amass").mkdir(parents=True)
    shutil.copy(ROOT / "reproduce.sh", project)
    for name in ("pyproject.toml", "constraints.txt"):
        (project / name).touch()
    (project / ".venv" / "installed").write_text(f"{EVERYTHING}\n")
    for name in ("dsnet", "ruff", "pyright", "python"):
        write_command(project, name, 'echo "$@"')
    for name in ("body f.pkl", "women.h5", "men.h5", "women.txt"):
        (caller / name).touch()

    write_command(project, "nvidia-smi", "exit 6")  # its answer where there is no GPU
    found_first = os.pathsep.join([str(project / ".venv" / "bin"), os.environ["PATH"]])

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        command = [str(project / "reproduce.sh"), *options]
        environment = {**os.environ, "PATH": found_first}
        environment.pop("DSNET_RUNS", None)
        return subprocess.run(
            command, cwd=caller, env=environment, capture_output=True, text=True, check=False
        )

    return run


def stages(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    assert done.returncode == 0, done.stderr
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


@pytest.mark.parametrize(
    ("options", "common", "own"),
    [
        ("", "--profile demo --run demo", {}),
        ("--aligner robust", "--profile demo --run demo", {"align": "--aligner robust"}),
        ("--leave-out a b", "--profile demo --run demo", {"align": "--leave-out a b"}),
        (
            "--preset literal --profile smoke",
            "--profile smoke --run smoke_literal",
            {
                "align": "--aligner sgd",
                "train-ae": "--preset literal",
                "train": "--predictors dsnet_faithful",
            },
        ),
        (
            "--gender male --profile smoke",
            "--profile smoke --run smoke_male",
            {"corpus": "--gender male"},
        ),
        ("--gender female", "--profile demo --run demo", {"corpus": "--gender female"}),
        ("--gender male --run m", "--profile demo --run m", {"corpus": "--gender male"}),
    ],
)
def test_options_reach_their_stages(
    reproduce: Reproduce, options: str, common: str, own: dict[str, str]
) -> None:
    called = stages(reproduce(*options.split()))
    assert list(called) == STAGES
    expected = {stage: f"{common} --seed 0 {own.get(stage, '')}".strip() for stage in STAGES}
    assert called == expected


@pytest.mark.parametrize("options", [("--profile", "paper"), ("--seeds", "3", "--run", "paper")])
def test_other_seeds_learn_from_the_same_alignment(
    reproduce: Reproduce, tmp_path: Path, options: tuple[str, ...]
) -> None:
    """Three in `paper`: their runs have the first one's stages, and its report comes last."""
    runs = tmp_path / "project" / "runs"
    (runs / "paper" / "align_robust").mkdir(parents=True)
    done = reproduce(*options, "--seed", "4")
    assert done.returncode == 0, done.stderr
    called = [line.split() for line in done.stdout.splitlines()]
    own = ["train", "infer", "decode", "evaluate"]
    assert [words[0] for words in called] == [*STAGES[:-1], *own, *own, "report"]
    of = [(words[words.index("--run") + 1], words[-1]) for words in called]
    first, last = [("paper", "4")] * 8, ("paper", "4")
    assert of == [*first, *[("paper-seed5", "5")] * 4, *[("paper-seed6", "6")] * 4, last]
    for other in ("paper-seed5", "paper-seed6"):
        assert [path.name for path in (runs / other).iterdir()] == ["align_robust"]
        assert (runs / other / "align_robust").samefile(runs / "paper" / "align_robust")


def test_licensed_files_take_the_corpus_place(reproduce: Reproduce, tmp_path: Path) -> None:
    files = ("--smpl", "body f.pkl", "--dyna", "women.h5", "men.h5", "--amass", "amass")
    files += ("--amass-list", "women.txt", "--amass-fps", "60")
    options = ("--profile", "paper", "--seeds", "1", "--run", "x", "--seed", "3")
    called = stages(reproduce(*options, *files))
    assert list(called) == STAGES[1:]
    common, at = "--profile paper --run x --seed 3", tmp_path / "caller"
    meshes = f"--dyna {at}/women.h5 {at}/men.h5"
    assert called["align"] == f"{common} --smpl {at}/body f.pkl {meshes}"
    motions = f"--amass {at}/amass --amass-list {at}/women.txt --amass-fps 60"
    assert called["infer"] == f"{common} {motions}"
    assert called["train"] == common
    again = ("--dyna", f"{at}/women.h5", "--smpl", f"{at}/body f.pkl", "--dyna", "men.h5")
    assert meshes in stages(reproduce(*again))["align"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "short"], "--preset short; expected literal or literal_per_coordinate"),
        (["--preset", "literal", "--aligner", "sgd"], "--preset literal with --aligner or --dmpl"),
        (["--gender", "neutral"], "--gender neutral; expected female or male"),
        (["--gender", "male", "--smpl", "body f.pkl"], "--gender male with licensed files"),
        (["--dyna", "men.h5", "--gender", "male"], "--gender male with licensed files"),
        (["--smpl", "none.pkl", "--dyna", "women.h5"], "none.pkl does not exist"),
        (["--smpl", "body f.pkl", "--dyna", "women.h5", "none.h5"], "none.h5 does not exist"),
        (["--amass", "nowhere"], "nowhere does not exist"),
        (["--amass-list", "nowhere"], "nowhere does not exist"),
        (["--smpl"], "--smpl needs a value"),
        (["--dynamics"], "unknown option --dynamics"),
        (["--seeds", "0"], "--seeds 0; expected 1 to 9"),
        (["--aligner", "x"], "--aligner x; expected sgd, robust or both"),
    ],
)
def test_slips_are_told_before_anything_runs(
    reproduce: Reproduce, options: list[str], words: str
) -> None:
    done = reproduce(*options)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def documented_commands() -> list[str]:
    """Calls of the script in README and docs/data.md that run stages."""
    pages = [(ROOT / name).read_text() for name in ("README.md", "docs/data.md")]
    lines = [line.partition("  #")[0].strip() for page in pages for line in page.splitlines()]
    return sorted({line for line in lines if re.match(r"\./reproduce\.sh(?! test| setup)", line)})


@pytest.mark.parametrize("command", documented_commands())
def test_documented_commands_are_understood(
    reproduce: Reproduce, tmp_path: Path, command: str
) -> None:
    options = [word for word in shlex.split(command)[1:] if word != "..."]
    for word in options:
        if word.isupper() or "." in word:
            (tmp_path / "caller" / word).touch()
    assert list(stages(reproduce(*options))) == STAGES["--dyna" in options :]


def test_help_is_the_scripts_head(reproduce: Reproduce) -> None:
    done = reproduce("--help")
    assert (done.returncode, done.stderr) == (0, "")
    for name in ("--profile", "--aligner", "--amass", "setup", "test --slow"):
        assert name in done.stdout
    assert "set -e" not in done.stdout
    assert "#" not in done.stdout


def test_an_installation_that_fails_is_not_taken_for_one(
    reproduce: Reproduce, tmp_path: Path
) -> None:
    stamp = tmp_path / "project" / ".venv" / "installed"
    stamp.unlink()
    write_command(tmp_path / "project", "python", "exit 7")
    done = reproduce()
    assert done.returncode == 7
    assert done.stdout == ""
    assert not stamp.exists()


def test_what_is_installed_suffices_for_what_is_asked(reproduce: Reproduce, tmp_path: Path) -> None:
    """Runs ask for less than tests, so that neither installs again after the other."""
    stamp = tmp_path / "project" / ".venv" / "installed"
    stamp.write_text(f"{FOR_RUNS}\n")
    assert "pip install" not in reproduce().stdout
    for options in (["--engine", "ray"], ["test"], ["setup"]):
        stamp.write_text(f"{FOR_RUNS}\n")
        assert f"--editable .[{EVERYTHING}]" in reproduce(*options).stdout
        assert stamp.read_text() == f"{EVERYTHING}\n"
        assert "pip install" not in reproduce().stdout
    (tmp_path / "project" / "constraints.txt").write_text("numpy==2.2.6\n")
    assert f"--editable .[{FOR_RUNS}]" in reproduce().stdout


def test_a_gpu_decides_between_builds(reproduce: Reproduce, tmp_path: Path) -> None:
    """Of what another machine's kind of setup has left, the frameworks go first."""
    project = tmp_path / "project"
    stamp, removed = project / ".venv" / "installed", "-m pip uninstall -qq --yes tensorflow"
    stamp.unlink()
    assert removed not in (first := reproduce().stdout)
    assert f"--editable .[{FOR_RUNS}]" in first
    write_command(project, "nvidia-smi", "echo GPU 0")
    on_gpu = reproduce().stdout
    assert on_gpu.index(removed) < on_gpu.index("--editable .[train,usd,clip]")
    assert removed not in reproduce("setup").stdout
    write_command(project, "nvidia-smi", "exit 6")
    assert removed in reproduce("setup").stdout


@pytest.mark.parametrize("status", [0, 1])
def test_pytorch_without_cuda_is_asked_for_where_there_is_no_gpu(
    reproduce: Reproduce, tmp_path: Path, status: int
) -> None:
    """Its index may be out of reach: then the other one's is installed with the rest."""
    project, asked = tmp_path / "project", tmp_path / "asked"
    script = f'case "$*" in *whl/cpu*) echo "$@" >>{asked}; exit {status} ;; esac; echo "$@"'
    write_command(project, "python", script)
    (project / ".venv" / "installed").unlink()
    assert f"--editable .[{FOR_RUNS}]" in reproduce().stdout
    assert "--constraint constraints.txt torch --no-deps" in asked.read_text()
    asked.unlink()
    write_command(project, "nvidia-smi", "echo GPU 0")
    assert "--editable .[train,usd,clip]" in reproduce().stdout
    assert not asked.exists()


def test_tests_of_each_side_have_a_process(reproduce: Reproduce) -> None:
    done = reproduce("test")
    assert done.returncode == 0, done.stderr
    *linters, first, second = done.stdout.splitlines()
    assert linters == ["check .", "format --check .", ""]
    assert first.endswith(" tests/tf_dsnet")
    assert "-m pytest" in second
    assert second.endswith("--ignore tests/tf_dsnet")
    assert "slow" not in done.stdout
    *_, first, second = reproduce("test", "--slow").stdout.splitlines()
    expression = " -m not (browser or cluster or faults or fuzz)"
    assert first.endswith(f" tests/tf_dsnet{expression}")
    assert second.endswith(f"--ignore tests/tf_dsnet{expression}")


@pytest.mark.parametrize(
    ("options", "fails", "status"),
    [
        (["--slow"], "tests/tf_dsnet", 1),
        (["--slow"], "--ignore", 5),  # pytest's answer where it finds no test
        ([], "tests/tf_dsnet", 5),
        ([], "--ignore", 1),
    ],
)
def test_a_failure_of_either_side_is_the_commands(
    reproduce: Reproduce,
    tmp_path: Path,
    options: list[str],
    fails: str,
    status: int,
) -> None:
    other = "*--ignore*" if fails != "--ignore" else "none"
    script = f'case "$*" in {other}) ;; *{fails}*) exit {status} ;; esac'
    write_command(tmp_path / "project", "python", script)
    assert reproduce("test", *options).returncode == status
