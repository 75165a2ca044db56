"""How a command ends: a mistake, a full disk and a signal are one line each, never a traceback."""

from __future__ import annotations

import atexit
import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import NoReturn

from bridge.errors import DsnetError

_ROOM = "room on the disk", "Make room and run the same command: it goes on where it was."
_ALLOWED = "a path that may be read and written", "Change its permissions, or name another path."
_FILES = "a process that may open more files", "Raise its limit, as by `ulimit -n 4096`."
_MEMORY = "enough memory", "Free some and run the same command: it goes on where it was."
_EXPECTED = {
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
    errno.EFBIG: _ROOM,
    errno.EACCES: _ALLOWED,
    errno.EPERM: _ALLOWED,
    errno.EROFS: _ALLOWED,
    errno.ENOTDIR: ("a folder", "Name another one, or move the file that has its name."),
    errno.EEXIST: ("a folder", "Name another one, or move the file that has its name."),
    errno.ENAMETOOLONG: ("names of at most 255 bytes", "Name another path."),
    errno.EMFILE: _FILES,
    errno.ENFILE: _FILES,
    errno.ENOMEM: _MEMORY,
    errno.EIO: ("a disk without faults", "Check the disk; `dsnet check` names damaged files."),
}
"""What a user can mend of what the system refuses: what was expected, and how."""

_ENDING: dict[int, str] = {
    signal.SIGINT: "interrupted; run the same command to go on",
    signal.SIGTERM: "terminated; run the same command to go on",
}
"""What is answered, by signal."""
_PAUSE_S = 0.1


class Terminated(BaseException):
    """The system asked the process to end (SIGTERM)."""


@contextmanager
def exit_with_one_line(*, answer_signals: bool = True) -> Iterator[None]:
    """Turn what a user or the system can cause into one line and an exit status.

    A `DsnetError` and a refusal of the system such as a full disk end with 2, an interrupt with
    130 and SIGTERM with 143; who stops reading what is printed needs no line. A process that
    another one began leaves the signals to that one.
    """
    with ExitStack() as opened:
        if answer_signals:
            opened.enter_context(_answered_by(_end_work))
            # Nothing is left to interrupt but the interpreter's own end, which would not be silent.
            opened.callback(atexit.register, _be_deaf)
            opened.callback(atexit.unregister, _be_deaf)
        try:
            try:
                yield
            finally:
                print(end="", flush=True)  # noqa: T201
        except DsnetError as error:
            _say(error)
            sys.exit(2)
        except MemoryError:
            _say(DsnetError("work without the memory that it needs", *_MEMORY))
            sys.exit(2)
        except BrokenPipeError:
            if _is_printed("\n"):
                raise
            sys.exit(141)  # as whom SIGPIPE ends
        except OSError as error:
            if error.errno not in _EXPECTED:
                raise
            _is_printed()
            _say(_refusal(error))
            sys.exit(2)
        except KeyboardInterrupt:
            _stop(signal.SIGINT)
        except Terminated:
            _stop(signal.SIGTERM)


def _is_printed(text: str = "") -> bool:
    """Whether stdout takes it; else all is dropped that would fail at the interpreter's end."""
    try:
        print(end=text, flush=True)  # noqa: T201
    except OSError:
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), sys.stdout.fileno())
        return False
    return True


def _refusal(error: OSError) -> DsnetError:
    """A refusal of the system in the words of all others."""
    assert error.errno is not None
    place = f"{error.filename}: " if error.filename else ""
    # Libraries put a paragraph of their own into `error.strerror`.
    return DsnetError(f"{place}{os.strerror(error.errno)}", *_EXPECTED[error.errno])


@contextmanager
def ends_at_once() -> Iterator[None]:
    """A signal in this block ends the process, which has begun nothing, with its line.

    Libraries that load swallow an exception, or turn it into another; what they print may be held
    back meanwhile.
    """
    stderr = os.dup(2) if sys.stderr else os.open(os.devnull, os.O_WRONLY)

    def end_process(number: int, _frame: FrameType | None) -> NoReturn:
        os.write(stderr, f"dsnet: {_ENDING[number]}\n".encode())
        os._exit(128 + number)

    try:
        with _answered_by(end_process):
            yield
    finally:
        os.close(stderr)


@contextmanager
def _answered_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Answer SIGINT and SIGTERM so, unless they are ignored or another thread's."""
    before: dict[int, signal._HANDLER] = {}
    if threading.current_thread() is threading.main_thread():
        for one in _ENDING:
            if signal.getsignal(one) not in (signal.SIG_IGN, None):
                before[one] = signal.signal(one, handler)
    try:
        yield
    finally:
        for one, earlier in before.items():
            signal.signal(one, earlier)


def _end_work(number: int, frame: FrameType | None) -> None:
    """Have the work undone that is under way; where it is a library's loading, after that."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            again = threading.Timer(_PAUSE_S, _signal_main, [number])
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def _signal_main(number: int) -> None:
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        signal.raise_signal(number)


def _stop(number: int) -> NoReturn:
    _be_deaf()  # to who presses Ctrl-C three times
    _say(_ENDING[number])
    sys.exit(128 + number)


def _be_deaf() -> None:
    for one in _ENDING:
        signal.signal(one, signal.SIG_IGN)


def _say(what: object) -> None:
    print(f"dsnet: {what}", file=sys.stderr)  # noqa: T201


@contextmanager
def signals_postponed() -> Iterator[None]:
    """SIGINT and SIGTERM are answered after this block, once, however often they came in it.

    For waiting until threads have ended: Python up to 3.12 takes a thread for ended whose waiting
    was interrupted, and then does not wait for it before the interpreter's own end either, which
    ends a thread that is in PyTorch's code by aborting the process.
    """
    came: list[int] = []
    try:
        with _answered_by(lambda number, _frame: came.append(number)):
            yield
    finally:
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
