"""The `dsnet` command: one subcommand a stage, each in a process of its own.

A subcommand's options are the fields of the configuration that its module
holds, so this file knows names and modules only, and imports a framework only
when its stage is asked for.
"""

from __future__ import annotations

import importlib
import os
import shutil
import sys
from collections.abc import Callable, Sequence

from bridge import __version__
from bridge.endings import ends_at_once, exit_with_one_line
from bridge.errors import DsnetError, did_you_mean

COMMANDS = {
    "corpus": (
        "torch_align_ae.corpus.stage_corpus",
        "Make the synthetic corpus in the real formats.",
    ),
    "align": (
        "torch_align_ae.alignment.stage_align",
        "Fit SMPL to meshes; unpose the offsets.",
    ),
    "train-ae": ("torch_align_ae.autoencoder.stage_train_ae", "Train the mesh autoencoder."),
    "encode": ("torch_align_ae.autoencoder.stage_encode", "Encode the offsets as latents."),
    "train": ("tf_dsnet.stage_train", "Train DSNet on latents and motions."),
    "train-plus": (
        "tf_dsnet.stage_train_plus",
        "Fit dsnet_plus, oscillators on the skin, to offsets.",
    ),
    "predict": ("bridge.runtime.stage_predict", "Predict latents; with --motion, a moving body."),
    "export": (
        "bridge.export.stage_export",
        "Write a moving body for Blender, Maya, Houdini, Unreal.",
    ),
    "predict-plus": (
        "tf_dsnet.stage_predict_plus",
        "Predict offsets with dsnet_plus.",
    ),
    "decode": ("torch_align_ae.autoencoder.stage_decode", "Decode latents to offsets."),
    "evaluate": ("bridge.measure.stage_evaluate", "Measure errors against meshes and references."),
    "report": ("bridge.report.stage_report", "Draw the figures and write the report."),
    "verify": (
        "bridge.verify.stage_verify",
        "Compare NumPy, PyTorch, Keras, ONNX by layer.",
    ),
    "view": ("bridge.view.stage_view", "Look at predictions in a browser, as they move."),
    "check": ("bridge.runs.stage_check", "Compare a run's files and chain with its digests."),
}
PROFILES = ("smoke", "demo", "paper")
_NARROWEST = 40
"""Columns of a terminal, below which the parser breaks lines for ever."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: run one subcommand."""
    with exit_with_one_line():
        with ends_at_once():
            work = _dispatch(list(sys.argv[1:] if arguments is None else arguments))
        work()


def _dispatch(arguments: list[str]) -> Callable[[], None]:
    """What the command line asks for, to be called; nothing is begun before."""
    # Late, so that whoever interrupts while these load reads one line.
    import dataclasses

    import tyro

    from bridge.installation import require_packages_of
    from bridge.options import check_options, parse_seed
    from bridge.runs.engines import use_engine

    if not arguments or arguments[0] in ("-h", "--help"):
        return lambda: print(_overview())  # noqa: T201
    if arguments == ["--version"]:
        return lambda: print(f"dsnet {__version__}")  # noqa: T201
    command, *options = arguments
    if command not in COMMANDS:
        raise DsnetError(
            f"command {command!r}",
            f"one of {', '.join(COMMANDS)}",
            did_you_mean(command, COMMANDS, "See dsnet --help."),
        )
    profile = _take_profile(options)
    engine, address = _take(options, "--engine"), _take(options, "--address")
    require_packages_of(COMMANDS[command][0])
    module = importlib.import_module(COMMANDS[command][0])
    default = module.PROFILES[profile]
    names = {field.name for field in dataclasses.fields(default)}
    if getattr(default, "run", None):  # some need no run
        default = dataclasses.replace(default, run=profile)
    prog = f"dsnet {command} [--profile P] [--engine local|ray [--address HOST:PORT]]"
    if "seed" not in names:
        # ./reproduce.sh hands one seed to every command.
        prog += " [--seed N]"
        if (seed := _take(options, "--seed")) is not None:
            parse_seed(seed)
    if shutil.get_terminal_size().columns < _NARROWEST:
        os.environ["COLUMNS"] = str(_NARROWEST)
    config = tyro.cli(type(default), args=options, default=default, prog=prog)
    check_options(config)

    def work() -> None:
        with use_engine("local" if engine is None else engine, address):
            module.main(config)

    return work


def _take_profile(options: list[str]) -> str:
    """Remove `--profile NAME` from `options`: it chooses the defaults that --help shows."""
    profile = _take(options, "--profile")
    if profile is not None and profile not in PROFILES:
        raise DsnetError(
            f"profile {profile!r}",
            f"one of {', '.join(PROFILES)}",
            did_you_mean(profile, PROFILES, "Pass --profile demo."),
        )
    return profile or "demo"


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
        f"{rows}\n\nEvery command has its own --help; ./reproduce.sh runs them in this order."
    )
