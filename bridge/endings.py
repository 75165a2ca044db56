"""How a command ends: a mistake, a full disk and a signal are one line each, never a traceback."""

from __future__ import annotations

import atexit
import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from bridge.errors import DsnetError

_ROOM = "room on the disk", "Make room and run the same command: it goes on where it was."
_WRITABLE = "a folder that may be written", "Change its permissions, or name another folder."
_EXPECTED = {
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
    errno.EFBIG: _ROOM,
    errno.EACCES: _WRITABLE,
    errno.EPERM: _WRITABLE,
    errno.EROFS: _WRITABLE,
    errno.ENOTDIR: ("a folder", "Name another one, or move the file that has its name."),
    errno.EEXIST: ("a folder", "Name another one, or move the file that has its name."),
    errno.EIO: ("a disk without faults", "Check the disk; `dsnet check` names damaged files."),
}
"""What a user can mend of what the system refuses: what was expected, and how."""


class Terminated(BaseException):
    """The system asked the process to end (SIGTERM)."""


@contextmanager
def exit_with_one_line(*, answer_signals: bool = True) -> Iterator[None]:
    """Turn what a user or the system can cause into one line and an exit status.

    A `DsnetError` and a refusal of the system such as a full disk end with 2, an interrupt with
    130 and SIGTERM with 143. A process that another one began leaves the signals to that one.
    """
    before = _when_terminated(_terminate) if answer_signals else None
    try:
        yield
    except DsnetError as error:
        _say(error)
        sys.exit(2)
    except OSError as error:
        if error.errno not in _EXPECTED:
            raise
        _say(_refusal(error))
        sys.exit(2)
    except KeyboardInterrupt:
        _stop("interrupted", signal.SIGINT)
    except Terminated:
        _stop("terminated", signal.SIGTERM)
    finally:
        if before is not None:
            _when_terminated(before)
        if answer_signals:
            # Nothing is left to interrupt but the interpreter's own end, which would not be silent.
            atexit.unregister(_be_deaf)
            atexit.register(_be_deaf)


def _refusal(error: OSError) -> DsnetError:
    """A refusal of the system in the words of all others."""
    assert error.errno is not None
    place = f"{error.filename}: " if error.filename else ""
    # Libraries put a paragraph of their own into `error.strerror`.
    return DsnetError(f"{place}{os.strerror(error.errno)}", *_EXPECTED[error.errno])


def _stop(how: str, number: signal.Signals) -> NoReturn:
    _be_deaf()  # to who presses Ctrl-C three times
    _say(f"{how}; run the same command to go on")
    sys.exit(128 + number)


def _be_deaf() -> None:
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.SIG_IGN)


def _say(what: object) -> None:
    print(f"dsnet: {what}", file=sys.stderr)  # noqa: T201


def _when_terminated(handler: signal._HANDLER) -> signal._HANDLER:
    """Answer SIGTERM by `handler`; returns what did so before, None where there is no asking."""
    if threading.current_thread() is not threading.main_thread():
        return None
    if signal.getsignal(signal.SIGTERM) is signal.SIG_IGN:
        return None
    return signal.signal(signal.SIGTERM, handler)


def _terminate(_number: int, _frame: FrameType | None) -> NoReturn:
    raise Terminated


@contextmanager
def signals_postponed() -> Iterator[None]:
    """SIGINT and SIGTERM are answered after this block, once, however often they came in it.

    For waiting until threads have ended: Python up to 3.12 takes a thread for ended whose waiting
    was interrupted, and then does not wait for it before the interpreter's own end either, which
    ends a thread that is in PyTorch's code by aborting the process.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {
        one: signal.signal(one, lambda number, _frame: came.append(number))
        for one in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(one) not in (signal.SIG_IGN, None)
    }
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
        if came:
            signal.raise_signal(came[0])


@contextmanager
def interrupts_withheld() -> Iterator[None]:
    """Processes begun in this block never see an interrupt from the keyboard, from their start on.

    It reaches every process of the terminal; the first one alone answers it, and ends the others.
    Windows has no such mask: there `ignore_interrupts` does it, once they have loaded it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_interrupts() -> None:
    """Never answer an interrupt in this process, begun in a block of `interrupts_withheld`."""
    if not hasattr(signal, "pthread_sigmask"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
