"""Options: nonsense is refused before any work, whatever the command."""

from __future__ import annotations

import dataclasses
import importlib
import math
from dataclasses import dataclass, field

import pytest

from bridge import DsnetError
from bridge.options import (
    Bounds,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    Seed,
    check_options,
)
from dsnet.cli import COMMANDS, main
from dsnet.report.stage_report import ReportConfig

# TensorFlow and PyTorch are never imported into one process.
HERE = [command for command in COMMANDS if command != "train"]


@dataclass(frozen=True)
class Inner:
    precision_m: PositiveFloat = 1e-3


@dataclass(frozen=True)
class Config:
    run: str = "r"
    seed: int = 0
    other_seed: Seed = 0
    batch_size: PositiveInt = 16
    frames: PositiveInt | None = None
    epochs: NonNegativeInt = 0
    lr: NonNegativeFloat = 0.0
    sizes: tuple[PositiveInt, ...] = ()
    plain: int = 0
    shift: float = -1.0
    masked: bool = False
    robust: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    "config",
    [
        Config(),
        Config(seed=2**32 - 1, batch_size=1, frames=1, sizes=(1, 2), plain=0, masked=True),
        Config(robust=Inner(1e-9)),
    ],
)
def test_what_makes_sense_passes(config):
    check_options(config)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (Config(batch_size=-3), "--batch-size -3; expected 1 or more. Pass --batch-size N."),
        (Config(frames=0), "--frames 0; expected 1 or more"),
        (Config(epochs=-1), "--epochs -1; expected 0 or more"),
        (Config(plain=-1), "--plain -1; expected 0 or more"),
        (Config(lr=-1e-9), "--lr -1e-09; expected 0 or more"),
        (Config(lr=math.nan), "--lr nan; expected 0 or more"),
        (Config(shift=math.inf), "--shift inf; expected a finite number"),
        (Config(sizes=(3, 0)), "--sizes 0; expected 1 or more"),
        (Config(seed=-1), "--seed -1; expected 0 to 4294967295"),
        (Config(seed=2**32), "--seed 4294967296; expected 0 to 4294967295"),
        (Config(other_seed=-1), "--other-seed -1; expected 0 to 4294967295"),
        (Config(robust=Inner(0.0)), "--robust.precision-m 0.0; expected more than 0"),
        (ReportConfig(panel_px=0), "--panel-px 0; expected 1 or more"),
    ],
)
def test_what_makes_none_is_one_line(config, message):
    with pytest.raises(DsnetError) as caught:
        check_options(config)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("bounds", "held", "text"),
    [
        (Bounds(0, 20), [0, 1, 20], "0 to 20"),
        (Bounds(0, 20, ends_open=True), [1], "more than 0 and less than 20"),
        (Bounds(0), [0, 1, 20, 30], "0 or more"),
        (Bounds(0, ends_open=True), [1, 20, 30], "more than 0"),
        (Bounds(), [-1, 0, 1, 20, 30], "a finite number"),
    ],
)
def test_bounds_say_what_they_hold(bounds, held, text):
    given = [-math.inf, -1, 0, 1, 20, 30, math.inf, math.nan]
    assert [value for value in given if bounds.hold(value)] == held
    assert str(bounds) == text


@pytest.mark.parametrize("command", HERE)
@pytest.mark.parametrize("seed", ["-1", "4294967296", "99999999999", "1.5", "x"])
def test_every_command_refuses_a_seed_that_is_none(command, seed, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    with pytest.raises(SystemExit) as stopped:
        main([command, "--seed", seed])
    assert stopped.value.code == 2
    assert "seed" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_seed_is_taken_by_a_command_without_one(monkeypatch):
    @dataclass(frozen=True)
    class Seedless:
        run: str = "demo"

    seen = []
    module = importlib.import_module(COMMANDS["check"][0])
    monkeypatch.setattr(module, "PROFILES", {"demo": Seedless()})
    monkeypatch.setattr(module, "main", seen.append)
    main(["check", "--seed", "7", "--run", "x"])
    main(["check", "--seed=7"])
    assert seen == [Seedless("x"), Seedless("demo")]


@pytest.mark.parametrize("command", HERE)
def test_the_profiles_pass_their_own_check(command):
    profiles = importlib.import_module(COMMANDS[command][0]).PROFILES
    for config in profiles.values():
        assert dataclasses.is_dataclass(config)
        check_options(config)
