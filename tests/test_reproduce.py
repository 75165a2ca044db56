"""`reproduce.sh` hands its options on, with paths as the caller means them; no stage is run."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# fmt: off
STAGES = [
    "corpus", "align", "train-ae", "encode", "train", "predict", "decode", "evaluate", "report",
]
# fmt: on

Reproduce = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def reproduce(tmp_path: Path) -> Reproduce:
    """The script beside a `dsnet` that prints its arguments, called from a folder with files."""
    project, caller = tmp_path / "project", tmp_path / "caller"
    (project / ".venv" / "bin").mkdir(parents=True)
    (caller / "amass").mkdir(parents=True)
    shutil.copy(ROOT / "reproduce.sh", project)
    for name in ("pyproject.toml", "constraints.txt", ".venv/installed"):
        (project / name).touch()
    dsnet = project / ".venv" / "bin" / "dsnet"
    dsnet.write_text('#!/bin/sh\necho "$@"\n')
    dsnet.chmod(0o755)
    for name in ("body f.pkl", "women.h5", "men.h5"):
        (caller / name).touch()

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        command = [str(project / "reproduce.sh"), *options]
        return subprocess.run(command, cwd=caller, capture_output=True, text=True, check=False)

    return run


def stages(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    assert done.returncode == 0, done.stderr
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


def test_every_stage_in_order_by_default(reproduce: Reproduce) -> None:
    called = stages(reproduce())
    assert list(called) == STAGES
    assert set(called.values()) == {"--profile demo --run demo --seed 0"}


def test_licensed_files_take_the_corpus_place(reproduce: Reproduce, tmp_path: Path) -> None:
    files = ("--smpl", "body f.pkl", "--dyna", "women.h5", "men.h5", "--amass", "amass")
    called = stages(reproduce("--profile", "paper", *files, "--run", "x", "--seed", "3"))
    assert list(called) == STAGES[1:]
    common, at = "--profile paper --run x --seed 3", tmp_path / "caller"
    meshes = f"--dyna {at}/women.h5 {at}/men.h5"
    assert called["align"] == f"{common} --smpl {at}/body f.pkl {meshes}"
    assert called["predict"] == f"{common} --amass {at}/amass"
    assert called["train"] == common


def test_absolute_paths_and_repeated_options(reproduce: Reproduce, tmp_path: Path) -> None:
    at = tmp_path / "caller"
    options = ("--dyna", f"{at}/women.h5", "--smpl", f"{at}/body f.pkl", "--dyna", "men.h5")
    assert f"--dyna {at}/women.h5 {at}/men.h5" in stages(reproduce(*options))["align"]


def test_aligner_is_handed_on(reproduce: Reproduce) -> None:
    called = stages(reproduce("--aligner", "robust"))
    assert called.pop("align").endswith("--aligner robust")
    assert not any("aligner" in options for options in called.values())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--smpl", "none.pkl", "--dyna", "women.h5"], "none.pkl does not exist"),
        (["--smpl", "body f.pkl", "--dyna", "women.h5", "none.h5"], "none.h5 does not exist"),
        (["--amass", "nowhere"], "nowhere does not exist"),
        (["--smpl"], "--smpl needs a value"),
        (["--dynamics"], "unknown option --dynamics"),
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


def test_meshes_without_a_body_reach_align_which_refuses(reproduce: Reproduce) -> None:
    called = stages(reproduce("--dyna", "women.h5"))
    assert "corpus" not in called
    assert "--smpl" not in called["align"]
