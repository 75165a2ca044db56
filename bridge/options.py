"""What a command's options may be, checked in one place before any work is done.

A configuration's annotations say it: `steps: PositiveInt = 140`. Without one of these a whole
number may be 0 or more and any other number must be finite.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from bridge.errors import DsnetError, did_you_mean, unknown_name


@dataclass(frozen=True)
class Bounds:
    """The numbers that an option may be; infinite and undefined ones never are."""

    least: float = -math.inf
    most: float = math.inf
    ends_open: bool = False
    """Whether `least` and `most` themselves are refused."""

    def hold(self, value: float) -> bool:
        at_end = not self.ends_open and value in (self.least, self.most)
        return math.isfinite(value) and (at_end or self.least < value < self.most)

    def __str__(self) -> str:
        if self.most < math.inf and self.ends_open:
            return f"more than {self.least:g} and less than {self.most:g}"
        if self.most < math.inf:
            return f"{self.least:.0f} to {self.most:.0f}"
        if self.least > -math.inf:
            return f"more than {self.least:g}" if self.ends_open else f"{self.least:g} or more"
        return "a finite number"


NO_OPTION = "no option"
"""Stands in the annotation of what is a setting in Python, and no option of a command."""
_SEEDS = Bounds(0, 2**32 - 1)
_WHOLE = Bounds(0)

PositiveInt = Annotated[int, Bounds(1)]
NonNegativeInt = Annotated[int, _WHOLE]
PositiveFloat = Annotated[float, Bounds(0, ends_open=True)]
NonNegativeFloat = Annotated[float, Bounds(0)]
Seed = Annotated[int, _SEEDS]


def check_options(config: Any) -> None:
    """Refuse a configuration (a dataclass; nested ones too) with a number that makes no sense, or
    nothing to call what is to be written.
    """
    if (path := getattr(config, "out", None)) is not None and not path.name:
        raise DsnetError(
            f"--out {str(path)!r}", "a path with a name of its own", "Pass --out PATH."
        )
    for flag, bounds, value in _numbers(config, "--"):
        if not bounds.hold(value):
            raise DsnetError(f"{flag} {value}", str(bounds), f"Pass {flag} N.")
    for name, hint in get_type_hints(type(config)).items():
        flag, value = f"--{name.replace('_', '-')}", getattr(config, name)
        words, plain = words_of(alternatives(hint)), _plain(hint)
        if words and value not in words and not isinstance(value, plain):
            raise unknown_name(f"{flag} {value}", str(value), words, f"Pass {flag} {words[0]}.")
        is_number = {*plain} - {NoneType} in ({int}, {float, int})
        if is_number and isinstance(value, str) and not words:
            raise DsnetError(f"{flag} {value!r}", "a number", f"Pass {flag} N.")


def numbers_by_name(
    option: str, words: Iterable[str], names: Sequence[str], bounds: Bounds, remedy: str
) -> dict[str, float]:
    """What words such as `belly=2` say, each name of `names` at most once."""
    numbers: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        if name not in names or name in numbers:
            again = ", given before" if name in numbers else ""
            expected = f"each of {', '.join(names)} at most once"
            raise DsnetError(f"{option} {word}{again}", expected, did_you_mean(name, names, remedy))
        try:
            numbers[name] = float(text)
        except ValueError:
            numbers[name] = math.nan
        if not bounds.hold(numbers[name]):
            raise DsnetError(f"{option} {word}", f"a number, {bounds}", remedy)
    return numbers


def _numbers(config: Any, prefix: str) -> Iterator[tuple[str, Bounds, float]]:
    """Flag, bounds and value of every number in a configuration."""
    hints = get_type_hints(type(config), include_extras=True)
    for field in fields(config):
        flag = prefix + field.name.replace("_", "-")
        value = getattr(config, field.name)
        if is_dataclass(value):
            yield from _numbers(value, f"{flag}.")
            continue
        for number in value if isinstance(value, (tuple, list)) else (value,):
            if isinstance(number, (int, float)) and not isinstance(number, bool):
                usual = _WHOLE if isinstance(number, int) else Bounds()
                bounds = _stated(hints[field.name]) or (_SEEDS if field.name == "seed" else usual)
                yield flag, bounds, number


def alternatives(hint: Any) -> list[Any]:
    """The types that an annotation allows: of `float | Literal["auto"] | None` all three."""
    if get_origin(hint) is Annotated:
        return alternatives(hint.__origin__)
    if get_origin(hint) in (Union, UnionType):
        return [kind for one in get_args(hint) for kind in alternatives(one)]
    return [hint]


def words_of(kinds: Iterable[Any]) -> list[str]:
    """The words that types allow: of `Literal["auto"]` one."""
    return [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]


def _plain(hint: Any) -> tuple[type, ...]:
    """The alternatives that are no words; a whole number is a number too."""
    plain = tuple(one for one in alternatives(hint) if isinstance(one, type))
    return (*plain, int) if float in plain else plain


def _stated(hint: Any) -> Bounds | None:
    """The bounds somewhere in an annotation, as in `PositiveInt | None`."""
    if get_origin(hint) is Annotated:
        stated = [item for item in hint.__metadata__ if isinstance(item, Bounds)]
        return stated[0] if stated else _stated(hint.__origin__)
    return next(filter(None, map(_stated, get_args(hint))), None)
