"""User-facing errors and notices: the exception that users see, and lines on stderr."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from difflib import get_close_matches

_LONGEST = 4000
_heard: ContextVar[list[str] | None] = ContextVar("_heard", default=None)


def printable(text: str) -> str:
    """Text whose control characters are escaped: a file's names may not steer a terminal."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def _shortened(text: str) -> str:
    """A long text, as from a damaged file or a command line, without its middle."""
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}"


def notify(text: str) -> None:
    """One line on stderr about something that a user would want to know but need not mend."""
    if (heard := _heard.get()) is not None:
        heard.append(printable(text))
        return
    print(f"dsnet: {printable(text)}", file=sys.stderr)  # noqa: T201


@contextmanager
def notices() -> Iterator[list[str]]:
    """What is notified in this thread while the block runs, in place of stderr."""
    heard: list[str] = []
    before = _heard.set(heard)
    try:
        yield heard
    finally:
        _heard.reset(before)


def did_you_mean(name: str, known: Iterable[str], remedy: str, prefix: str = "") -> str:
    """The remedy for a name that is none of those known, after the nearest of them if one is near.

    `prefix` is written before the nearest name, but no part of what is compared.
    """
    meant = {one.lower(): prefix + one for one in known}
    near = [meant[one] for one in get_close_matches(_shortened(name).lower(), meant, n=1)]
    # A name that is known is wrong for another reason.
    return f"Did you mean {near[0]!r}? {remedy}" if near and near[0] != name else remedy


class DsnetError(Exception):
    """A mistake that a user can mend: in one line what was received, what was expected, the remedy.

    The `dsnet` command prints it without a traceback and exits with status 2.
    """

    def __init__(self, received: str, expected: str, remedy: str) -> None:
        self.received, self.expected, self.remedy = received, expected, remedy
        line = f"{_shortened(received)}; expected {_shortened(expected)}. {remedy}"
        super().__init__(printable(" ".join(line.split())))

    def __reduce__(self) -> tuple[type[DsnetError], tuple[str, str, str]]:
        """As its parts, so that it also comes back from a worker process."""
        return type(self), (self.received, self.expected, self.remedy)


def unknown_name(received: str, name: str, known: Collection[str], remedy: str) -> DsnetError:
    """The refusal of a name that is none of those known; `received` also says where it stood."""
    return DsnetError(received, f"one of {', '.join(known)}", did_you_mean(name, known, remedy))


class MissingPackageError(DsnetError, ModuleNotFoundError):
    """A package of an extra is not installed; whoever expects an ImportError gets one."""


class InterruptedWorkError(DsnetError):
    """Work was stopped by something other than its inputs: what was done stays, to be resumed."""
