"""`dsnet report --update`: which commands make old stages again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bridge import DsnetError
from bridge.runs import Artifact, Run, write_artifact
from dsnet.report import update
from dsnet.report.update import command_again, update_stages, without_options

SETTINGS = {"epochs": 3, "seed": 0}
NETWORKS = {"default": "a", "predictors": {"a": SETTINGS, "b": {**SETTINGS, "network": "x"}}}


def made_by(command: str, stage: str, **recorded: Any) -> Artifact:
    """Stage of run `r` that a command has made."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", command.split())
        path = Run("r").path / stage
        return write_artifact(path, stage, {}, units={}, data="synthetic", **recorded)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """`encode` and, made of it by recorded commands, `train`, `infer`, `evaluate`."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    before = made_by("dsnet encode --run first --seed 2", "encode")
    for stage in ("train", "infer", "evaluate"):
        upstream = {before.path.name: before.content_sha256}
        command = f"dsnet {stage} --run=first --predictors a"
        before = made_by(command, stage, config=NETWORKS, upstream=upstream)
    return Run("r")


def test_the_recorded_options_are_those_of_the_present_run(run):
    assert command_again(run, "encode") == ("encode", ("--seed", "2", "--run", "r"))
    # All networks that the run holds, not the one that was added last.
    assert command_again(run, "train") == ("train", ("--predictors", "a", "b", "--run", "r"))


def test_a_file_names_no_cluster_and_no_folder_to_write(run):
    options = "--engine=ray --address elsewhere:1 --markers m --out o"
    made_by(f"dsnet evaluate --profile smoke {options}", "evaluate")
    assert command_again(run, "evaluate") == ("evaluate", ("--profile", "smoke", "--run", "r"))


def test_networks_of_an_older_run_are_named_too(run):
    made_by("dsnet train", "train", config={"epochs": 3, "predictors": ["a", "b"]})
    assert command_again(run, "train") == ("train", ("--predictors", "a", "b", "--run", "r"))


def test_old_stages_run_in_order_and_a_failure_ends_it(run, monkeypatch):
    commands = []

    def outcome(module: str, *command: str, quiet: bool) -> tuple[int, str]:
        commands.append(command[0])
        return (3 if command[0] == "evaluate" else 0), ""

    monkeypatch.setattr(update, "outcome_of_module", outcome)
    made_by("dsnet encode", "encode", other=1)
    with pytest.raises(SystemExit) as ended:
        update_stages(run, ["encode", "train", "infer", "evaluate"])
    assert ended.value.code == 3
    assert commands == ["train", "infer", "evaluate"]


def test_what_one_command_does_not_make_is_refused(run):
    made_by("study.py", "infer")
    with pytest.raises(DsnetError, match=r"study\.py"):
        command_again(run, "infer")
    networks = {"default": "a", "predictors": {"a": SETTINGS, "b": {**SETTINGS, "epochs": 4}}}
    made_by("dsnet train", "train", config=networks)
    with pytest.raises(DsnetError, match="different settings"):
        command_again(run, "train")


def test_an_option_goes_with_its_values():
    given = ["--a", "1", "2", "--b=3", "--c"]
    assert without_options(given, "--a") == ["--b=3", "--c"]
    assert without_options(given, "--b") == ["--a", "1", "2", "--c"]
