"""The `dsnet` command: one subcommand a stage, each in a process of its own.

A subcommand's options are the fields of the configuration that its module holds, so this file knows
names and modules only, and imports a framework only when its stage is asked for.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from importlib import import_module
from typing import Any

from bridge import __version__
from bridge.errors import unknown_name
from bridge.processes import exit_with_one_line
from dsnet.command_line import (
    PROFILES,
    flowed,
    options_type,
    refuse_unreadable,
    refuse_words_without_name,
)

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
    "predict": ("dsnet.prediction.stage_predict", "Write the moving body of a motion as arrays."),
    "export": ("dsnet.exporters.stage_export", "Write a body for Blender, Maya, Houdini, Unreal."),
    "view": ("dsnet.view.stage_view", "Show predictions in a browser, as they move."),
    "verify": ("dsnet.verify.stage_verify", "Compare NumPy, PyTorch, Keras, ONNX by layer."),
    "check": ("dsnet.stages.stage_check", "Compare a run's files and chain with its digests."),
}
GROUPS = {
    "Move bodies": ("predict", "export", "view"),
    "Train and evaluate, in the order of ./reproduce.sh": (
        *("corpus", "align", "train-ae", "encode", "train", "infer", "decode"),
        *("evaluate", "report"),
    ),
    "Check": ("verify", "check"),
}
"""Commands as `dsnet --help` lists them."""
SHELLS = ("bash", "zsh", "fish")
"""Shells for which there is a completion script."""
_END_FOR_BASH = """
_dsnet() {
  _tyro_dsnet
  [[ ${COMPREPLY[0]} ]] || COMPREPLY=()
  [[ ! -e ${COMPREPLY[0]} ]] || compopt -o filenames
}
complete -F _dsnet dsnet"""
"""The parser's script alone ends what it does not know, and the names of folders, with a space."""
_NARROWEST = 40
"""Columns of a terminal, below which the parser breaks lines for ever."""


def main(arguments: Sequence[str] | None = None, **settings: Any) -> None:
    """Entry point: run one subcommand.

    A study may give `settings`: fields of the configuration, by name, that are no options.
    """
    with exit_with_one_line():
        match [*(sys.argv[1:] if arguments is None else arguments)]:
            case [] | ["help"] | ["-h" | "--help", *_]:
                print(_overview())  # noqa: T201
            case ["-V" | "--version" | "version"]:
                print(f"dsnet {__version__}")  # noqa: T201
            case ["--completion", *shell]:
                _print_completion(" ".join(shell))
            case ["help", command, *_]:
                _run(command, ["--help"], settings)
            case [command, *options]:
                _run(command, options, settings)


def _run(command: str, options: list[str], settings: Mapping[str, Any]) -> None:
    if command not in COMMANDS:
        raise unknown_name(f"command {command!r}", command, COMMANDS, "See dsnet --help.")
    refuse_words_without_name(command, options)
    # It chooses the defaults that --help shows.
    profile = _take(options, "--profile")
    profile = "demo" if profile is None else profile
    if profile not in PROFILES:
        raise unknown_name(f"profile {profile!r}", profile, PROFILES, "Pass --profile demo.")
    # Late, so that whoever interrupts while these load reads one line.
    import tyro

    from bridge.options import check_options
    from bridge.runs.workers import use_engine

    module = import_module(COMMANDS[command][0])
    default = _with(_default(command, profile), settings)
    columns = shutil.get_terminal_size().columns
    if columns < _NARROWEST:
        os.environ["COLUMNS"] = str(columns := _NARROWEST)
    if {"-h", "--help"} & {*options}:  # the parser would not break its lines
        print(flowed(type(default).__doc__ or "", columns), end="\n\n")  # noqa: T201
    # What only studies set is `Fixed`: no option.
    kind = options_type(default, command, profile)
    refuse_unreadable(command, options, kind)
    parsed = tyro.cli(
        kind,
        args=options,
        prog=f"dsnet {command}",
        description="",
        config=(tyro.conf.SuppressFixed,),
    )
    check_options(parsed)
    config = replace(default, **{one.name: getattr(parsed, one.name) for one in fields(default)})
    with use_engine(parsed.engine, parsed.address):
        module.main(config)


def _default(command: str, profile: str) -> Any:
    """A command's configuration where no option is given; MissingPackageError where it needs more
    than is installed."""
    default = import_module(COMMANDS[command][0]).PROFILES[profile]
    # Some commands need no run.
    return replace(default, run=profile) if getattr(default, "run", None) else default


def _print_completion(shell: str) -> None:
    """Print the script by which a shell completes commands and options."""
    if shell not in SHELLS:
        raise unknown_name(f"--completion {shell}", shell, SHELLS, "Pass --completion bash.")
    import tyro

    kinds = {}
    for command in COMMANDS:
        try:
            default = _default(command, "demo")
        except ModuleNotFoundError:  # its framework is not installed
            default = None
        kinds[command] = options_type(default, command, "demo")
    with suppress(SystemExit):
        tyro.extras.subcommand_cli_from_dict(
            kinds,
            prog="dsnet",
            args=["--tyro-print-completion", shell],
            config=(tyro.conf.SuppressFixed,),
        )
    if shell == "bash":
        print(_END_FOR_BASH)  # noqa: T201


def _with(config: Any, settings: Mapping[str, Any]) -> Any:
    """A configuration with other values of some fields; mappings are of fields within a field."""
    own = {
        name: _with(getattr(config, name), value) if isinstance(value, Mapping) else value
        for name, value in settings.items()
    }
    return replace(config, **own)


def _take(options: list[str], flag: str) -> str | None:
    """Remove `flag VALUE` and `flag=VALUE` from `options`: the last value, None without one."""
    taken = None
    for index in reversed(range(len(options))):
        name, equals, value = options[index].partition("=")
        if name == flag:
            value = value if equals else "".join(options[index + 1 : index + 2])
            del options[index : index + (1 if equals else 2)]
            taken = value if taken is None else taken
    return taken


def _overview() -> str:
    lines = [
        "Predict how the soft tissue of a moving SMPL body deforms.",
        "",
        "usage: dsnet COMMAND [OPTIONS]",
        "       dsnet help COMMAND",
        f"       dsnet --completion {'|'.join(SHELLS)}",
        "       dsnet --version",
    ]
    for title, commands in GROUPS.items():
        lines += ["", f"{title}:", *(f"  {one:<11}{COMMANDS[one][1]}" for one in commands)]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
