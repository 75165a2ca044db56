"""`dsnet report --update`: which commands make old stages again."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge import DsnetError
from bridge.runs import Run, write_artifact
from dsnet.report import update
from dsnet.report.update import command_again, update_stages, without_options

SETTINGS = {"epochs": 3, "seed": 0}


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    return tmp_path


@pytest.fixture
def run(runs, monkeypatch) -> Run:
    """`encode` and, made of it by recorded commands, `train`, `infer`, `evaluate`."""
    monkeypatch.setattr("sys.argv", ["dsnet", "encode", "--run", "first", "--seed", "2"])
    before = write_artifact(runs / "r" / "encode", "encode", {}, units={}, data="synthetic")
    for stage in ("train", "infer", "evaluate"):
        monkeypatch.setattr("sys.argv", ["dsnet", stage, "--run=first", "--predictors", "a"])
        networks = {
            "default": "a",
            "predictors": {"a": SETTINGS, "b": {**SETTINGS, "network": "x"}},
        }
        before = write_artifact(
            runs / "r" / stage, stage, {}, units={}, data="synthetic", config=networks,
            upstream={before.path.name: before.content_sha256},
        )  # fmt: skip
    return Run("r")


def test_the_recorded_options_are_those_of_the_present_run(run):
    assert command_again(run, "encode") == ("encode", ("--seed", "2", "--run", "r"))
    # All networks that the run holds, not the one that was added last.
    assert command_again(run, "train") == ("train", ("--predictors", "a", "b", "--run", "r"))


def test_a_file_names_no_cluster_and_no_folder_to_write(run, monkeypatch, runs):
    options = ["--engine=ray", "--address", "elsewhere:1", "--markers", "m", "--out", "o"]
    monkeypatch.setattr("sys.argv", ["dsnet", "evaluate", "--profile", "smoke", *options])
    write_artifact(runs / "r" / "evaluate", "evaluate", {}, units={}, data="synthetic")
    assert command_again(run, "evaluate") == ("evaluate", ("--profile", "smoke", "--run", "r"))


def test_networks_of_an_older_run_are_named_too(run, monkeypatch, runs):
    monkeypatch.setattr("sys.argv", ["dsnet", "train"])
    older = {"epochs": 3, "predictors": ["a", "b"]}
    write_artifact(runs / "r" / "train", "train", {}, units={}, data="synthetic", config=older)
    assert command_again(run, "train") == ("train", ("--predictors", "a", "b", "--run", "r"))


def test_old_stages_run_in_order_and_a_failure_ends_it(run, monkeypatch, runs):
    commands = []

    def outcome(module: str, *command: str, quiet: bool) -> tuple[int, str]:
        commands.append(command[0])
        return (3 if command[0] == "evaluate" else 0), ""

    monkeypatch.setattr(update, "outcome_of_module", outcome)
    write_artifact(runs / "r" / "encode", "encode", {}, units={}, data="synthetic", other=1)
    with pytest.raises(SystemExit) as ended:
        update_stages(run, ["encode", "train", "infer", "evaluate"])
    assert ended.value.code == 3
    assert commands == ["train", "infer", "evaluate"]


def test_what_was_not_made_by_a_command_is_refused(run, monkeypatch, runs):
    monkeypatch.setattr("sys.argv", ["study.py"])
    write_artifact(runs / "r" / "infer", "infer", {}, units={}, data="synthetic")
    with pytest.raises(DsnetError, match=r"study\.py"):
        command_again(run, "infer")


def test_networks_of_different_settings_are_not_trained_again_as_one(run, runs, monkeypatch):
    monkeypatch.setattr("sys.argv", ["dsnet", "train"])
    networks = {"default": "a", "predictors": {"a": SETTINGS, "b": {**SETTINGS, "epochs": 4}}}
    write_artifact(runs / "r" / "train", "train", {}, units={}, data="synthetic", config=networks)
    with pytest.raises(DsnetError, match="different settings"):
        command_again(run, "train")


def test_an_option_goes_with_its_values():
    given = ["--a", "1", "2", "--b=3", "--c"]
    assert without_options(given, "--a") == ["--b=3", "--c"]
    assert without_options(given, "--b") == ["--a", "1", "2", "--c"]
