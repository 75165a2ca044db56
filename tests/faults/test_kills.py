"""A stage killed anywhere, and run again: the undisturbed bytes, and nothing left over."""

from __future__ import annotations

import random
import shutil
import signal
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.faults.conftest import LONG, SEED, Base, asked
from tests.faults.stages import (
    COMMANDS,
    Ended,
    Stage,
    check_as_undisturbed,
    copy_before,
    finished,
    make,
)

pytestmark = pytest.mark.faults
FAULT = "kill"
INTERRUPTED = COMMANDS if LONG else ("align", "train", "infer")


@dataclass(frozen=True)
class Kill:
    """When a stage is stopped: before a file operation, or some time after its start."""

    command: str
    at_operation: bool
    share: float
    """Of its operations, or of its seconds."""

    def __str__(self) -> str:
        return f"{self.command}-{'file' if self.at_operation else 'time'}-{self.share:.3f}"


def drawn() -> list[Kill]:
    """Each stage in turn, every other time before a file operation; half of those in its end."""
    rng = random.Random(SEED)
    kills = []
    for number in range(asked("KILLS", len(COMMANDS))):
        turn, row = divmod(number, len(COMMANDS))
        at_operation = (turn + row) % 2 == 0
        late = at_operation and rng.random() < 0.5
        kills.append(Kill(COMMANDS[row], at_operation, rng.uniform(0.9 if late else 0.0, 1.0)))
    return kills


def stop(kill: Kill, base: Base, runs: Path) -> Ended:
    if kill.at_operation:
        operation = 1 + int(kill.share * (base.file_operations[kill.command] - 1))
        return Stage(kill.command, runs, operation).end()
    stage = Stage(kill.command, runs)
    time.sleep(kill.share * base.seconds[kill.command])
    if stage.process.poll() is None:
        stage.signal_group(signal.SIGKILL)
    return stage.end()


@pytest.mark.parametrize("kill", drawn(), ids=str)
def test_a_killed_stage_ends_as_the_undisturbed_one(
    kill: Kill, base: Base, tmp_path: Path, tally: Counter[str]
) -> None:
    copy_before(kill.command, base.runs, tmp_path)
    killed = stop(kill, base, tmp_path)
    assert killed.status in (0, -signal.SIGKILL), killed.said
    was_finished = finished(kill.command, tmp_path)
    again = make(kill.command, tmp_path)
    assert again.status == 0, again.said
    assert "Traceback" not in again.said
    check_as_undisturbed(kill.command, base.runs, tmp_path)
    tally["ended before" if killed.status == 0 else "finished" if was_finished else "cut"] += 1
    tally["again as undisturbed"] += 1
    shutil.rmtree(tmp_path)


@pytest.mark.parametrize("command", INTERRUPTED)
@pytest.mark.parametrize(
    ("name", "number", "times", "status"),
    [
        ("interrupted", signal.SIGINT, 1, 130),
        ("interrupted", signal.SIGINT, 3, 130),
        ("terminated", signal.SIGTERM, 1, 143),
    ],
    ids=["ctrl-c", "ctrl-c-thrice", "sigterm"],
)
def test_a_stopped_stage_says_one_line(
    command: str,
    name: str,
    number: int,
    times: int,
    status: int,
    base: Base,
    tmp_path: Path,
    tally: Counter[str],
) -> None:
    """Whatever it was at: loading its libraries, waiting for a child, or computing."""
    copy_before(command, base.runs, tmp_path)
    rng = random.Random(f"{SEED} {command} {number} {times}")
    stage = Stage(command, tmp_path, counted=False)
    # Not while the interpreter itself begins, which answers with a traceback of its own.
    time.sleep(0.1 + rng.uniform(0.1, 0.9) * base.seconds[command])
    for _ in range(times):
        if stage.process.poll() is None:
            stage.signal_group(number)
            time.sleep(0.05)
    ended = stage.end()
    if ended.status:
        assert (ended.status, ended.lines) == (
            status,
            [f"dsnet: {name}; run the same command to go on"],
        )
    again = make(command, tmp_path)
    assert (again.status, again.lines) == (0, [])
    check_as_undisturbed(command, base.runs, tmp_path)
    tally[
        f"{name}{' thrice' if times > 1 else ''}, one line" if ended.status else "ended before"
    ] += 1
    shutil.rmtree(tmp_path)
