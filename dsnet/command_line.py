"""What a person reads of the command line: the options of a command, and what a mistake meant."""

from __future__ import annotations

import ast
import shlex
from collections.abc import Sequence
from dataclasses import field, fields, is_dataclass, make_dataclass
from functools import partial
from inspect import cleandoc, getsource
from itertools import pairwise
from pathlib import Path
from textwrap import dedent, fill
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from bridge.errors import DsnetError

_NAMED = {
    "predict": ("--motion", "--out"),
    "export": ("--motion", "--out"),
    "view": ("--motion",),
}
"""The options that are meant by words without a name; of all other commands it is the run."""

_REQUIRED = {"predict": ("motion", "out"), "export": ("to", "motion", "out")}
_FIRST = ("to", "motion", "motions", "out", "run", "predictor", "predictors", "write")
"""What stands first in a help, in this order."""
_INDENTED: Any = {"subsequent_indent": "  "}


def refuse_words_without_name(command: str, options: Sequence[str]) -> None:
    """DsnetError with the command line that was meant, if options begin with words of no name."""
    count = next((i for i, word in enumerate(options) if word.startswith("-")), len(options))
    names = _NAMED.get(command, ("--run",))
    if not 0 < count <= len(names) or {"-h", "--help"} & {*options}:
        return
    words, rest = options[:count], options[count:]
    meant = ["dsnet", command]
    if command == "export" and not any(word.partition("=")[0] == "--to" for word in rest):
        beside = Path(words[0].removeprefix("sample:")).with_suffix(".usd")
        words = [words[0], words[1] if count > 1 else str(beside)]
        suffix = Path(words[1]).suffix[1:].lower()
        meant += ["--to", "usd" if suffix in ("", "usda", "usdc") else suffix]
    for name, word in zip(names, words, strict=False):
        meant += [name, word]
    raise DsnetError(
        f"{shlex.join(['dsnet', command, *options[:count]])}, words without a name",
        "each after its option",
        f"Run: {shlex.join([*meant, *rest])}",
    )


def options_type(default: Any, command: str) -> type:
    """A dataclass of a configuration's fields for the parser: in the order of use, flowing helps.

    The parser alone would end a help's lines where the source does, and show `None` as a value.
    """
    # Late, as is the parser in the command: whoever interrupts while it loads reads one line.
    from tyro.conf import arg

    kind = type(default)
    hints, helps = get_type_hints(kind, include_extras=True), _helps(kind)
    required = _REQUIRED.get(command, ())
    shown = []
    for one in sorted(fields(kind), key=lambda one: _place(one.name)):
        hint, value = hints[one.name], getattr(default, one.name)
        if not is_dataclass(value):
            about: dict[str, Any] = {"help": helps.get(one.name, "")}
            if value is None:
                about["metavar"] = _metavar(hint)
            if value is None or value == ():
                about["help_behavior_hint"] = "(required)" if one.name in required else ""
            hint = Annotated[hint, arg(**about)]
        shown.append((one.name, hint, field(default_factory=partial(_same, value))))
    return make_dataclass(kind.__name__, shown, kw_only=True)


def flowed(text: str, width: int) -> str:
    """Paragraphs of a docstring as lines of at most `width` characters.

    All but the first are indented, as the parser joins lines that begin with a letter.
    """
    paragraphs = cleandoc(text).split("\n\n")
    return "\n\n".join(fill(" ".join(one.split()), width - 1, **_INDENTED) for one in paragraphs)


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
    """What an option's value may be, without None: `PATH`, `FLOAT|{auto}`."""
    if get_origin(hint) is Annotated:
        return _metavar(hint.__origin__)
    if get_origin(hint) is Literal:
        return f"{{{','.join(map(str, get_args(hint)))}}}"
    if get_args(hint):
        return "|".join(_metavar(one) for one in get_args(hint) if one is not NoneType)
    return hint.__name__.upper()
