"""How a process ends, and those that it begins: a framework in each, arrays pass on disk.

A mistake, a full disk and a signal are one line each, never a traceback. A process that was begun
here ends with the one that began it, however that ends.
"""

from __future__ import annotations

import atexit
import errno
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from bridge.errors import DsnetError

_ROOM = "room on the disk", "Make room and run the same command: it goes on where it was."
_ALLOWED = "a path that may be read and written", "Change its permissions, or name another path."
_FOLDER = "a folder", "Name another one, or move the file that has its name."
_FILES = "a process that may open more files", "Raise its limit, as by `ulimit -n 4096`."
_MEMORY = "enough memory", "Free some and run the same command: it goes on where it was."
_EXPECTED = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), _ROOM),
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), _ALLOWED),
    **dict.fromkeys((errno.ENOTDIR, errno.EEXIST), _FOLDER),
    **dict.fromkeys((errno.EMFILE, errno.ENFILE), _FILES),
    errno.ENAMETOOLONG: ("names of at most 255 bytes", "Name another path."),
    errno.ENOMEM: _MEMORY,
    errno.EIO: ("a disk without faults", "Check the disk; `dsnet check` names damaged files."),
}
"""What a user can mend of what the system refuses: what was expected, and how."""
_ENDING: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
"""What is answered, by signal."""
_LOCKING = {threading.Condition.__enter__.__code__, threading.Condition.__exit__.__code__}
"""After or before the lock's own step an exception leaves it taken, and a worker waits for ever."""
_PAUSE_S = 0.1
_PATIENCE_S = 10.0


_QUOTA = Path("/sys/fs/cgroup/cpu.max")
"""Microseconds of a container's cores in each period of so many, or `max`."""


def usable_cores() -> int:
    """Cores that this process may use: in a container or a batch job fewer than the machine has."""
    if hasattr(os, "sched_getaffinity"):  # on Linux
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    try:
        quota_us, period_us = map(int, _QUOTA.read_text(encoding="ascii").split())
    except (OSError, ValueError):
        return cores
    return min(cores, max(1, math.ceil(quota_us / period_us)))


class Terminated(KeyboardInterrupt):
    """The system asked the process to end (SIGTERM)."""


@contextmanager
def exit_with_one_line(*, answer_signals: bool = True) -> Iterator[None]:
    """Turn what a user or the system can cause into one line and an exit status.

    A `DsnetError` and a refusal of the system such as a full disk end with 2, an interrupt with
    130 and SIGTERM with 143; who stops reading what is printed needs no line. A process that
    another one began leaves the signals to that one.
    """
    raised: list[KeyboardInterrupt] = []
    with _signals_answered(raised) if answer_signals else nullcontext():
        try:
            try:
                yield
            except BaseException:
                if raised:  # A library, or a lock let go, may have made another exception of it.
                    raise raised[0] from None
                raise
            finally:
                print(end="", flush=True)  # noqa: T201
        except DsnetError as error:
            _end(error, 2)
        except MemoryError:
            _end(DsnetError("work without the memory that it needs", *_MEMORY), 2)
        except BrokenPipeError:
            if _is_printed("\n"):
                raise
            sys.exit(141)  # as whom SIGPIPE ends
        except OSError as error:
            if error.errno not in _EXPECTED:
                raise
            _is_printed()
            place = f"{error.filename}: " if error.filename else ""
            # Some libraries put a whole paragraph into `error.strerror`.
            received = f"{place}{os.strerror(error.errno)}"
            _end(DsnetError(received, *_EXPECTED[error.errno]), 2)
        except KeyboardInterrupt as error:
            _be_deaf()
            number = _number_of(error)
            _end(_line_of(number), 128 + number)


def _end(message: object, status: int) -> NoReturn:
    print(f"dsnet: {message}", file=sys.stderr)  # noqa: T201
    sys.exit(status)


def _number_of(interrupt: KeyboardInterrupt) -> int:
    return signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT


def _line_of(number: int) -> str:
    return f"{_ENDING[number]}; run the same command to go on"


def _is_printed(text: str = "") -> bool:
    """Whether stdout takes it; else all is dropped that would fail at the interpreter's end."""
    try:
        print(end=text, flush=True)  # noqa: T201
    except OSError:
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), sys.stdout.fileno())
        return False
    return True


def _be_deaf() -> None:
    for one in _ENDING:
        signal.signal(one, signal.SIG_IGN)


@contextmanager
def _signals_answered(raised: list[KeyboardInterrupt]) -> Iterator[None]:
    """For SIGINT and SIGTERM, unless they are ignored, the work under way is undone, once.

    What undoes it is put into `raised`. Where it would be swallowed, the signals come again a
    little later. Who has waited in vain for the work to be undone ends the process at once.
    """
    before: dict[int, Any] = {}
    began = 0.0

    def answer(number: int, frame: FrameType | None) -> None:
        nonlocal began
        if _is_fragile(frame):
            _come_again(number)
        elif not raised:
            began = time.monotonic()
            raised.append(KeyboardInterrupt() if number == signal.SIGINT else Terminated())
            raise raised[0]
        elif time.monotonic() > began + _PATIENCE_S:
            os.write(2, f"dsnet: {_line_of(number)}\n".encode())
            os._exit(128 + number)

    def pass_over(lost: sys.UnraisableHookArgs) -> None:
        if lost.exc_value not in raised:
            unraisable(lost)
        else:  # in `__del__` or the like, after which Python goes on
            _come_again(_number_of(raised.pop()))

    unraisable = sys.unraisablehook
    if threading.current_thread() is threading.main_thread():
        for one in _ENDING:
            if signal.getsignal(one) not in (signal.SIG_IGN, None):
                before[one] = signal.signal(one, answer)
        sys.unraisablehook = pass_over
    try:
        yield
    finally:
        if sys.unraisablehook is pass_over:
            sys.unraisablehook = unraisable
        for one, earlier in before.items():
            if signal.getsignal(one) is answer:  # else the process ends, and is deaf already
                signal.signal(one, earlier)
        # Nothing is left to interrupt but the interpreter's own end, which would not be silent.
        atexit.register(_be_deaf)


def _come_again(number: int) -> None:
    again = threading.Timer(_PAUSE_S, os.kill, [os.getpid(), number])
    again.daemon = True
    again.start()


def _is_fragile(frame: FrameType | None) -> bool:
    """Whether a library loads, which may swallow an exception, or a lock would stay taken."""
    while frame and not (
        frame.f_code in _LOCKING or frame.f_code.co_filename.startswith("<frozen importlib")
    ):
        frame = frame.f_back
    return frame is not None


@contextmanager
def interrupts_withheld() -> Iterator[None]:
    """Processes begun in this block never see an interrupt from the keyboard, from their start on.

    It reaches every process of the terminal; the first one alone answers it, and ends the others.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_CHILD = """
import runpy
from bridge.processes import end_with_parent
end_with_parent()
runpy.run_module({!r}, run_name="__main__", alter_sys=True)
"""


def outcome_of_module(module: str, *arguments: str, quiet: bool = True) -> tuple[int, str]:
    """Exit status and, if it is `quiet`, stderr of `python -m module arguments`."""
    command = [sys.executable, "-c", _CHILD.format(module), *arguments]
    stdout, stderr = (subprocess.DEVNULL, subprocess.PIPE) if quiet else (None, None)
    with interrupts_withheld():
        child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=stdout, stderr=stderr, encoding="locale"
        )
    with child:
        try:
            printed = child.stderr.read() if child.stderr else ""
            child.wait()
        except BaseException:
            child.kill()
            raise
    return child.returncode, printed


def end_with_parent() -> None:
    """End this process, begun by the above, when its parent does: nobody waits for it any more."""

    def watch() -> None:
        # A pipe of which the parent holds the other end, and into which it writes nothing.
        os.read(0, 1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
