"""A stage that counts its operations on files, and may kill itself before one of them.

    python stage_process.py COUNT_FILE KILL_AT SETTINGS COMMAND OPTION ...

What is counted lies below `DSNET_RUNS`. KILL_AT 0: never. SETTINGS are JSON.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

from dsnet.cli import main

_OPERATIONS = {"open", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate"}
_done = 0


def _counted(event: str, arguments: tuple[Any, ...]) -> bool:
    return event in _OPERATIONS and str(arguments[0]).startswith(os.environ["DSNET_RUNS"])


def _watch(kill_at: int) -> None:
    def count(event: str, arguments: tuple[Any, ...]) -> None:
        global _done
        if _counted(event, arguments):
            _done += 1
            if _done == kill_at:
                os.killpg(0, signal.SIGKILL)

    sys.addaudithook(count)


if __name__ == "__main__":
    count_file, kill_at, settings, *command = sys.argv[1:]
    atexit.register(lambda: Path(count_file).write_text(str(_done), encoding="utf-8"))
    _watch(int(kill_at))
    main(command, **json.loads(settings))
