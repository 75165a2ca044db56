"""Seconds of work on something that may be begun several times before it is finished."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from pathlib import Path

from bridge.runs.folders import write_text_atomically


class WorkTime:
    """A clock whose earlier turns lie in a file.

    A turn that was killed counts to the last file that it wrote among `made`: what came after
    was lost, and is done again.

    Parameters
    ----------
    path : Path
        The file, which lies where checkpoints do.
    made : iterable of Path
        Files of the turns before.
    """

    def __init__(self, path: Path, made: Iterable[Path]) -> None:
        self._started = time.perf_counter()
        self._before_s = _earlier_turns_s(path, made)
        text = json.dumps({"before_s": self._before_s, "begun": time.time()})
        write_text_atomically(path, text)

    @property
    def seconds(self) -> float:
        """Of all turns so far."""
        return self._before_s + time.perf_counter() - self._started


def _earlier_turns_s(path: Path, made: Iterable[Path]) -> float:
    """0 where the file is missing or damaged: a time is no reason to stop work."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        before_s, begun = float(kept["before_s"]), float(kept["begun"])
    except (OSError, ValueError, TypeError, KeyError):
        return 0.0
    last = max((file.stat().st_mtime for file in made if file != path), default=begun)
    return max(0.0, before_s) + max(0.0, last - begun)
