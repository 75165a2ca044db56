"""A command in a process of its own: its CPU time, and the most memory that it had."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bridge.errors import DsnetError

_EVERY_S = 0.02


@dataclass(frozen=True)
class ChildUse:
    """What a command took, with all processes that it started."""

    cpu_s: float
    """User and system time."""
    wall_s: float
    anonymous_mb: float
    """Largest sum of anonymous memory (`RssAnon`): what no file can give back. Looked at fifty
    times a second, so that a peak that is shorter may be missed."""
    resident_mb: float
    """Largest sum of resident memory (`VmRSS`): pages of mapped files too, which the system takes
    back when it is short."""


def measured(command: Sequence[str], environment: Mapping[str, str]) -> ChildUse:
    """Run a command to its end (Linux only).

    Raises
    ------
    DsnetError
        If it fails; with the end of what it said.
    """
    started, most = time.perf_counter(), {"RssAnon": 0.0, "VmRSS": 0.0}
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen(
            command, env={**os.environ, **environment}, stdout=subprocess.DEVNULL, stderr=said
        )
        while not (ended := os.wait4(child.pid, os.WNOHANG))[0]:
            for key, now in _memory_mb(child.pid).items():
                most[key] = max(most[key], now)
            time.sleep(_EVERY_S)
        _, status, used = ended
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            said.seek(0)
            raise DsnetError(
                f"`{' '.join(command[-8:])}` with exit status {child.returncode}: "
                f"{said.read().strip()[-500:]}",
                "a command that succeeds",
                "Run it by hand.",
            )
    wall_s = time.perf_counter() - started
    return ChildUse(used.ru_utime + used.ru_stime, wall_s, most["RssAnon"], most["VmRSS"])


def _memory_mb(process: int) -> dict[str, float]:
    """`RssAnon` and `VmRSS` of a process and all that it has started, MiB."""
    found = {"RssAnon": 0.0, "VmRSS": 0.0}
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
        threads = list(Path(f"/proc/{process}/task").iterdir())
        children = [
            one
            for thread in threads
            for one in (thread / "children").read_text(encoding="utf-8").split()
        ]
    except OSError:  # it has ended
        return found
    for line in lines:
        key, _, value = line.partition(":")
        if key in found:
            found[key] = int(value.split()[0]) / 1024
    for child in children:
        for key, value in _memory_mb(int(child)).items():
            found[key] += value
    return found
