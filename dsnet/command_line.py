"""What a person reads of the command line: the options of a command, and what a mistake meant."""

from __future__ import annotations

import ast
import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass, make_dataclass
from functools import partial
from inspect import cleandoc, getsource
from itertools import pairwise
from pathlib import Path
from textwrap import dedent, fill
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from bridge.errors import DsnetError, did_you_mean
from bridge.options import NO_OPTION, Seed, alternatives, words_of

Profile = Literal["smoke", "demo", "paper"]
PROFILES: tuple[Profile, ...] = get_args(Profile)


@dataclass(frozen=True)
class CommonOptions:
    """What every command has besides the fields of its configuration."""

    profile: Profile = "demo"
    """Defaults of the other options, --run too: `smoke` for a try, `demo` for minutes of training,
    `paper` for hours at the paper's sizes."""
    engine: Literal["local", "ray"] = "local"
    """Where work in parallel runs: on this machine, or on the nodes of a Ray cluster."""
    address: str | None = None
    """Head of that cluster; without it, Ray is started on this machine."""
    seed: Seed = 0
    """No effect: this command draws no random numbers."""


_NAMED = {
    "predict": ("--motion", "--out"),
    "export": ("--motion", "--out"),
    "view": ("--motion",),
}
"""The options that are meant by words without a name; of all other commands it is the run."""

_REQUIRED = {"predict": ("motion", "out"), "export": ("to", "motion", "out")}
_FIRST = ("to", "motion", "motions", "out", "run", "predictor", "predictors", "write")
"""What stands first in a help, in this order."""
_METAVARS = {
    "address": "HOST:PORT",
    "betas": "B1,B2,...",
    "part_gain": "PART=GAIN ...",
    "shape": "NAME|MEASURE=VALUE ...",
    "to": "FORMAT",
}
"""What stands for a value in a help, where its type says too little."""


def refuse_words_without_name(command: str, options: Sequence[str]) -> None:
    """DsnetError with the command line that was meant, if options begin with words of no name."""
    count = next((i for i, word in enumerate(options) if word.startswith("-")), len(options))
    names = _NAMED.get(command, ("--run",))
    if not 0 < count <= len(names) or {"-h", "--help"} & {*options}:
        return
    words, rest = options[:count], options[count:]
    meant = ["dsnet", command]
    if command == "export" and not any(word.partition("=")[0] == "--to" for word in rest):
        beside = Path(words[0].removeprefix("sample:")).with_suffix(".usdz")
        words = [words[0], words[1] if count > 1 else str(beside)]
        suffix = Path(words[1]).suffix[1:].lower()
        meant += ["--to", "usd" if suffix in ("", "usda", "usdc", "usdz") else suffix]
    for name, word in zip(names, words, strict=False):
        meant += [name, word]
    raise DsnetError(
        f"{shlex.join(['dsnet', command, *options[:count]])}, words without a name",
        "each after its option",
        f"Run: {shlex.join([*meant, *rest])}",
    )


def refuse_unreadable(command: str, options: Sequence[str], kind: type) -> None:
    """DsnetError for an option that there is not, or for a value that its type cannot hold.

    The parser would answer with a box of many lines, in the words of Python's types.
    """
    known: dict[str, Any] = {"--help": bool}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if not _is_fixed(hint):
            flag = f"--{name.replace('_', '-')}"
            known[flag] = hint
            if bool in alternatives(hint):
                known[f"--no-{flag[2:]}"] = bool
    for index, word in enumerate(options):
        flag, equals, value = word.partition("=")
        flag = flag.replace("_", "-")
        if not flag.startswith("--") or "." in flag:
            continue
        if flag not in known:
            raise DsnetError(
                f"{flag} of dsnet {command}, unknown",
                "one of its options",
                did_you_mean(flag, known, f"See dsnet {command} --help."),
            )
        if bool in alternatives(known[flag]):
            continue
        if not equals:
            value = next(iter(options[index + 1 : index + 2]), "--")
        _refuse_value(flag, value, known[flag])


def _refuse_value(flag: str, value: str, hint: Any) -> None:
    """DsnetError unless a value is a number or one of the words that a type allows."""
    kinds = [one for one in alternatives(hint) if one is not NoneType]
    words = words_of(kinds)
    numbers = [one for one in kinds if one in (int, float)]
    if value.startswith("--"):
        raise DsnetError(f"{flag} without a value", _metavar(hint), f"Pass {flag} VALUE.")
    if value in words or any(
        get_origin(one) is not Literal and one not in numbers for one in kinds
    ):
        return
    for number in numbers:
        with suppress(ValueError):
            number(value)
            return
    expected = [", ".join(words)] if words else []
    expected += ["a whole number" if one is int else "a number" for one in numbers]
    remedy = f"Pass {flag} {words[0] if words else 'N'}."
    raise DsnetError(f"{flag} {value}", " or ".join(expected), did_you_mean(value, words, remedy))


def _is_fixed(hint: Any) -> bool:
    """Whether only studies or Python set a field: no option."""
    from tyro.conf import Fixed

    marked: Any = Fixed[int]
    marks = marked.__metadata__[0], NO_OPTION
    return get_origin(hint) is Annotated and any(one in marks for one in hint.__metadata__)


def options_type(default: Any, command: str, profile: Profile) -> type:
    """A dataclass for the parser: a configuration's fields in the order of use, then the common
    options. None stands for a configuration that cannot be loaded.

    The parser alone would end a help's lines where the source does, and show `None` as a value.
    """
    common = _shown(CommonOptions(profile=profile), ())
    if hasattr(default, "seed"):
        del common["seed"]
    if command in _NAMED:  # whose defaults are those of no run
        del common["profile"]
    own = {} if default is None else _shown(default, _REQUIRED.get(command, ()))
    shown = [(name, *rest) for name, rest in {**own, **common}.items()]
    return make_dataclass(command.replace("-", "_"), shown, kw_only=True)


def flowed(text: str, width: int) -> str:
    """Paragraphs of a docstring as lines of at most `width` characters."""
    return "\n\n".join(
        fill(" ".join(one.split()), width, break_on_hyphens=False)
        for one in cleandoc(text).split("\n\n")
    )


def _shown(default: Any, required: Sequence[str]) -> dict[str, tuple[Any, Any]]:
    """The fields of a configuration, by name: how the parser reads and explains each, its value."""
    # Late, as is the parser in the command: whoever interrupts while it loads reads one line.
    from tyro.conf import Fixed, arg

    kind = type(default)
    hints, helps = get_type_hints(kind, include_extras=True), _helps(kind)
    shown = {}
    for one in sorted(fields(default), key=lambda one: _place(one.name)):
        hint, value = hints[one.name], getattr(default, one.name)
        if _is_fixed(hint):
            hint = Fixed[hint]
        if not is_dataclass(value):
            about: dict[str, Any] = {"help": helps.get(one.name, "")}
            if not isinstance(value, bool):
                about["metavar"] = _METAVARS.get(one.name) or _metavar(hint)
            if value is None or value == ():
                about["help_behavior_hint"] = "(required)" if one.name in required else ""
            hint = Annotated[hint, arg(**about)]
        shown[one.name] = hint, field(default_factory=partial(_same, value))
    return shown


def _same(value: Any) -> Any:
    return value


def _place(name: str) -> int:
    return _FIRST.index(name) if name in _FIRST else len(_FIRST)


def _helps(kind: type) -> dict[str, str]:
    """What stands below each field in the source of a dataclass and of those that it extends."""
    found: dict[str, str] = {}
    for base in reversed([one for one in kind.__mro__ if is_dataclass(one)]):
        body = ast.parse(dedent(getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for stated, after in pairwise(body.body):
            if (
                isinstance(stated, ast.AnnAssign)
                and isinstance(stated.target, ast.Name)
                and isinstance(after, ast.Expr)
                and isinstance(after.value, ast.Constant)
            ):
                found[stated.target.id] = " ".join(str(after.value.value).split())
    return found


def _metavar(hint: Any) -> str:
    """What an option's value may be, without None: `PATH`, `FLOAT|{auto}`, `NAME ...`."""
    if get_origin(hint) is Annotated:
        return _metavar(hint.__origin__)
    if get_origin(hint) is Literal:
        return f"{{{','.join(map(str, get_args(hint)))}}}"
    if get_origin(hint) is tuple:
        return f"{_metavar(get_args(hint)[0])} ..."
    if get_args(hint):
        return "|".join(_metavar(one) for one in get_args(hint) if one is not NoneType)
    return "NAME" if hint is str else hint.__name__.upper()
