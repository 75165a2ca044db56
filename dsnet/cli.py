"""The `dsnet` command: one subcommand a stage, each in a process of its own.

A subcommand's options are the fields of the configuration that its module holds, so this file knows
names and modules only, and imports a framework only when its stage is asked for.
"""

from __future__ import annotations

import importlib
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from inspect import cleandoc
from typing import Any

from bridge import __version__
from bridge.errors import unknown_name
from bridge.processes import exit_with_one_line
from dsnet.command_line import flowed, options_type, refuse_words_without_name

COMMANDS = {
    "corpus": ("dsnet.synthetic.stage_corpus", "Make a synthetic corpus in real formats."),
    "align": ("torch_align_ae.alignment.stage_align", "Fit SMPL to meshes; unpose the offsets."),
    "train-ae": ("torch_align_ae.autoencoder.stage_train_ae", "Train the mesh autoencoder."),
    "encode": ("torch_align_ae.autoencoder.stage_encode", "Encode the offsets as latents."),
    "train": ("dsnet.stages.stage_train", "Train predictors: DSNet and dsnet_plus."),
    "infer": ("dsnet.stages.stage_infer", "Let a run's predictors predict its sequences."),
    "decode": ("torch_align_ae.autoencoder.stage_decode", "Decode latents to offsets."),
    "evaluate": ("dsnet.stages.stage_evaluate", "Measure errors against meshes and references."),
    "report": ("dsnet.report.stage_report", "Draw the figures and write the report."),
    "predict": ("dsnet.prediction.stage_predict", "Write the moving body of one motion to files."),
    "export": ("dsnet.exporters.stage_export", "Write a body for Blender, Maya, Houdini, Unreal."),
    "view": ("dsnet.view.stage_view", "Look at predictions in a browser, as they move."),
    "verify": ("dsnet.verify.stage_verify", "Compare NumPy, PyTorch, Keras, ONNX by layer."),
    "check": ("dsnet.stages.stage_check", "Compare a run's files and chain with its digests."),
}
PROFILES = ("smoke", "demo", "paper")
_NARROWEST = 40
"""Columns of a terminal, below which the parser breaks lines for ever."""


def main(arguments: Sequence[str] | None = None, **settings: Any) -> None:
    """Entry point: run one subcommand.

    A study may give `settings`: fields of the configuration, by name, that are no options.
    """
    with exit_with_one_line():
        given = sys.argv[1:] if arguments is None else arguments
        if not given or given[0] in ("-h", "--help"):
            print(_overview())  # noqa: T201
        elif [*given] == ["--version"]:
            print(f"dsnet {__version__}")  # noqa: T201
        else:
            _run(given[0], [*given[1:]], settings)


def _run(command: str, options: list[str], settings: Mapping[str, Any]) -> None:
    if command not in COMMANDS:
        raise unknown_name(f"command {command!r}", command, COMMANDS, "See dsnet --help.")
    refuse_words_without_name(command, options)
    # It chooses the defaults that --help shows.
    profile = _take(options, "--profile")
    if profile not in (None, *PROFILES):
        raise unknown_name(f"profile {profile!r}", profile, PROFILES, "Pass --profile demo.")
    engine, address = _take(options, "--engine"), _take(options, "--address")
    # Late, so that whoever interrupts while these load reads one line.
    import tyro

    from bridge.options import check_options, check_seed
    from bridge.runs.workers import use_engine

    module = importlib.import_module(COMMANDS[command][0])
    default = _with(module.PROFILES[profile or "demo"], settings)
    if getattr(default, "run", None):  # some need no run
        default = replace(default, run=profile or "demo")
    common = "--profile P, --engine E, --address A"
    if not hasattr(default, "seed"):
        # ./reproduce.sh hands one seed to every command.
        common += ", --seed N"
        if (seed := _take(options, "--seed")) is not None:
            check_seed(seed)
    columns = shutil.get_terminal_size().columns
    if columns < _NARROWEST:
        os.environ["COLUMNS"] = str(columns := _NARROWEST)
    about = f"{cleandoc(type(default).__doc__ or '')}\n\nAlso {common}."
    # What only studies set is `Fixed`: no option.
    parsed = tyro.cli(
        options_type(default, command),
        args=options,
        prog=f"dsnet {command}",
        description=flowed(about, columns),
        config=(tyro.conf.SuppressFixed,),
    )
    config = replace(default, **vars(parsed))
    check_options(config)
    with use_engine("local" if engine is None else engine, address):
        module.main(config)


def _with(config: Any, settings: Mapping[str, Any]) -> Any:
    """A configuration with other values of some fields; mappings are of fields within a field."""
    own = {
        name: _with(getattr(config, name), value) if isinstance(value, Mapping) else value
        for name, value in settings.items()
    }
    return replace(config, **own)


def _take(options: list[str], flag: str) -> str | None:
    """Remove `flag VALUE` or `flag=VALUE` from `options`; None if it is not there."""
    for index, option in enumerate(options):
        name, equals, value = option.partition("=")
        if name == flag:
            value = value if equals else "".join(options[index + 1 : index + 2])
            del options[index : index + (1 if equals else 2)]
            return value
    return None


def _overview() -> str:
    rows = "\n".join(f"  {name:<14}{summary}" for name, (_, summary) in COMMANDS.items())
    return (
        "usage: dsnet COMMAND [--profile smoke|demo|paper] [--run NAME] [--seed N] ...\n"
        "       dsnet --version\n\n"
        f"{rows}\n\nEvery command has its own --help; ./reproduce.sh runs the stages, corpus to "
        "report, in this order."
    )


if __name__ == "__main__":
    main()
