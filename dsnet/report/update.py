"""Stages that a change has made old are made again, by the commands that made them."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from typing import Any

from bridge.errors import DsnetError, notify
from bridge.processes import outcome_of_module
from bridge.runs import Run, read_artifact
from bridge.runs.run import TRAIN, command_of

_LEFT_OUT = ("--run", "--engine", "--address", "--markers", "--out")
"""Options that are not repeated: a run may come from somebody else, and what its files hold must
not name a cluster to connect to or a folder to write."""


def update_stages(run: Run, stages: list[str]) -> None:
    """Make the old ones of these finished stages again, in order, each in a process of its own.

    Their options are those that the artifacts record. `evaluate` runs in any case, as predictions
    may have come beside those that it measured. Ends the process with the status of a command that
    fails; raises `DsnetError` where no command is recorded.
    """
    old, _ = run.old_stages(stages)
    commands = [command_again(run, stage) for stage in dict.fromkeys((*old, "evaluate"))]
    for command, options in dict.fromkeys(commands):
        notify(shlex.join(["dsnet", command, *options]))
        status, _ = outcome_of_module("dsnet.cli", command, *options, quiet=False)
        if status:
            sys.exit(status)


def command_again(run: Run, stage: str) -> tuple[str, tuple[str, ...]]:
    """The command that made a stage of the run, and its options, for the run's present name."""
    artifact = read_artifact(run.path / stage)
    command, given = command_of(stage), artifact.manifest["provenance"].get("command", [])
    if given[1:2] != [command]:
        raise DsnetError(
            f"run {run.name!r}, whose {stage!r} was made by `{' '.join(given)}`",
            f"one made by `dsnet {command}`",
            f"Run `dsnet {command} --run {run.name}` yourself.",
        )
    options = without_options(given[2:], *_LEFT_OUT)
    if stage == TRAIN:
        options = without_options(options, "--predictors")
        options += ["--predictors", *_networks(run, artifact.manifest["config"]["predictors"])]
    return command, (*options, "--run", run.name)


def without_options(options: list[str], *flags: str) -> list[str]:
    """Options of a command line without those of some flags, and their values."""
    kept, is_value = [], False
    for option in options:
        if option.startswith("--"):
            is_value = option.partition("=")[0] in flags
        if not is_value:
            kept.append(option)
    return kept


def _networks(run: Run, settings: Mapping[str, Any] | list[str]) -> list[str]:
    """Names of the networks that one command can train again."""
    if isinstance(settings, list):  # of before each network had its own
        return settings
    of_all = [{**one, "network": ""} for one in settings.values()]
    if any(one != of_all[0] for one in of_all):
        raise DsnetError(
            f"run {run.name!r}, whose networks were trained with different settings",
            "one command that trains all again",
            f"Run `dsnet train --run {run.name} --predictors NAME ...` for each yourself.",
        )
    return [*settings]
