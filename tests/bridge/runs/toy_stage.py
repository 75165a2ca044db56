"""Kill a toy stage before each of its file operations, look at what is left, make it again.

    python toy_stage.py FOLDER fresh|replacing

Where nothing is replaced, before every fourth. Prints how many kills there were. Every stage is
made in a process of its own.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bridge.runs import ArtifactWriter, Run

OPERATIONS = {"open", "os.mkdir", "os.remove", "os.rename", "os.rmdir"}
PARTS = 3


@dataclass(frozen=True)
class Config:
    value: float = 2.0


def make(writer: ArtifactWriter, value: float, log: Path) -> None:
    """Three parts with a checkpoint each, a small array, a file with a writer's temporary file."""
    array = writer.array_file("x", (PARTS, 20_000), np.float64, "m")
    for part in range(PARTS):
        done = writer.checkpoints / f"part-{part}"
        if not done.exists():
            array.write(part, np.full((1, 20_000), value + part))
            done.touch()
            note(log, f"part {part}")
    writer.put("y", [value], "m")
    path = writer.file_path("deep/weights.bin")
    temporary = path.with_name(f".weights.{os.getpid()}")
    temporary.write_bytes(bytes(1000))
    temporary.rename(path)
    note(log, "made")


def build(log: Path, value: float) -> None:
    def fill(writer: ArtifactWriter) -> None:
        make(writer, value, log)

    Run("r").build("toy", Config(value), fill, data="synthetic", upstream={})


def note(log: Path, line: str) -> None:
    with open(log, "a", encoding="utf-8") as stream:
        stream.write(line + "\n")


def killed_before(step: int, work: Callable[[], Any]) -> bool:
    """Whether `work`, in a process of its own, was killed before its file operation `step`."""
    child = os.fork()
    if child == 0:
        left = [step]

        def count(event: str, _arguments: tuple[Any, ...]) -> None:
            if event in OPERATIONS:
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        work()
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, -signal.SIGKILL), f"step {step}: exit status {status}"
    return status != 0


def contents(folder: Path) -> dict[str, bytes]:
    """All files of the finished artifact but its manifest, which has the time of day."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files if p.suffix != ".json"}


def main(root: Path, replacing: bool) -> int:
    step, expected, gaps = 0, None, 0
    while True:
        home = root / str(step)
        home.mkdir()
        os.environ["DSNET_RUNS"] = str(home)
        log = home / "log"
        if replacing:
            build(home / "old-log", 1.0)
        killed = killed_before(step, lambda log=log: build(log, 2.0))
        made = log.exists() and "made" in log.read_text()
        seen = Run("r").finished("toy")
        if replacing and not seen:
            gaps += 1  # between two renames: a folder cannot be renamed over a full one
        elif replacing:
            value = Run("r").artifact("toy").array("y")[0]
            assert value in ([1.0, 2.0] if made else [1.0]), f"step {step}: {value}"
        build(log, 2.0)
        lines = log.read_text().splitlines()
        parts = [line for line in lines if line.startswith("part")]
        assert len(parts) <= PARTS + 1, f"step {step}: {lines}"
        assert not made or len(parts) == PARTS, f"step {step}: made again, {lines}"
        found = contents(home / "r" / "toy")
        expected = expected or {**found}
        assert found == expected, f"step {step}: other bytes"
        left = {path.name for path in (home / "r").iterdir()}
        assert left == {"toy"}, f"step {step}: {left}"
        if not killed:
            assert gaps <= 1
            return step
        step += 1 if replacing else 4


if __name__ == "__main__":
    sys.stdout.write(f"{main(Path(sys.argv[1]), sys.argv[2] == 'replacing')}\n")
