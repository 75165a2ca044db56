"""An export that the page asked for: `dsnet export` in a process of its own, and how far it is."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

_PERCENT = re.compile(rb"(\d+)%\|")
_LONGEST_MESSAGE = 1 << 16
_NOTICE = b"dsnet: "


class ExportJob:
    """The command `words` running, whose `--out` is `out`; a folder becomes a `.zip` of itself."""

    def __init__(self, words: Sequence[str], out: Path) -> None:
        self._out, self._said, self._share = out, b"", 0.0
        self._file: Path | None = None
        self._process = subprocess.Popen(
            [sys.executable, "-m", "dsnet.cli", *words, "--out", str(out)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={**os.environ, "DSNET_PROGRESS": "1"},
        )
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def _follow(self) -> None:
        """Read what the command says, as it says it, until it has ended."""
        with self._process as process:
            assert process.stderr is not None
            while said := os.read(process.stderr.fileno(), 4096):
                self._said = (self._said + said)[-_LONGEST_MESSAGE:]
                if shares := _PERCENT.findall(said):
                    self._share = int(shares[-1]) / 100
        if process.returncode == 0:
            whole = self._out
            if whole.is_dir():
                whole = Path(shutil.make_archive(str(whole), "zip", self._out))
                shutil.rmtree(self._out)
            self._file = whole

    def state(self) -> dict[str, Any]:
        """`share` done, 0 to 1, what was `told`; at its end the `file`, or why it `failed`."""
        ended = not self.runs  # asked first: what follows is then whole
        lines = [
            line[len(_NOTICE) :]
            for line in re.split(rb"[\r\n]+", self._said)
            if line.startswith(_NOTICE)
        ]
        told = [line.decode(errors="replace") for line in lines]
        state: dict[str, Any] = {"share": self._share, "told": told}
        if not ended:
            return state
        if self._file:
            return state | {"file": self._file.name}
        return state | {"failed": told[-1] if told else f"status {self._process.returncode}"}

    @property
    def runs(self) -> bool:
        """Whether the command has not ended."""
        return self._thread.is_alive()

    @property
    def file(self) -> Path | None:
        """What was written, when it is whole."""
        return None if self.runs else self._file

    def end(self) -> None:
        """Stop it if it still runs, and remove what it wrote."""
        with suppress(OSError):
            self._process.terminate()
        self._thread.join()
        if self._file:
            self._file.unlink(missing_ok=True)
