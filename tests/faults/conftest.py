"""What the suite is given and what it leaves: `DSNET_FAULTS_*`, a tiny run, and a tally.

DSNET_FAULTS_KILLS   how many kills (one a stage)
DSNET_FAULTS_FLIPS   how many flipped bytes in finished artifacts (120)
DSNET_FAULTS_LONG    with any value, every stage goes through every fault
DSNET_FAULTS_JSON    file to write the counts into
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from bridge.runs.writer import provenance
from tests.faults.stages import COMMANDS, make

LONG = "DSNET_FAULTS_LONG" in os.environ
SEED = 0


def asked(name: str, short: int) -> int:
    """How many of something: the environment's number, or the short suite's."""
    return int(os.environ.get(f"DSNET_FAULTS_{name}", short))


@dataclass(frozen=True)
class Base:
    """The undisturbed run."""

    runs: Path
    seconds: dict[str, float]
    """Of each stage."""
    file_operations: dict[str, int]


@pytest.fixture(scope="session")
def base(tmp_path_factory: pytest.TempPathFactory) -> Base:
    """A finished run of all stages, of a second of motion."""
    kept = os.environ.get("DSNET_FAULTS_BASE")
    runs = Path(kept) if kept else tmp_path_factory.mktemp("base")
    measured = runs / "measured.json"
    if measured.exists():
        return Base(runs, **json.loads(measured.read_text()))
    made = Base(runs, {}, {})
    for command in COMMANDS:
        started = time.monotonic()
        ended = make(command, made.runs)
        assert ended.status == 0, ended.said
        made.seconds[command] = time.monotonic() - started
        made.file_operations[command] = ended.file_operations
    measured.write_text(
        json.dumps({"seconds": made.seconds, "file_operations": made.file_operations})
    )
    return made


Tally = dict[str, Counter[str]]
_counts: Tally = {}


@pytest.fixture(scope="module")
def tally(request: pytest.FixtureRequest) -> Counter[str]:
    """Counts of outcomes, one of each of the module's trials."""
    return _counts.setdefault(request.module.FAULT, Counter())


@pytest.fixture(scope="session", autouse=True)
def _leave_counts() -> Iterator[None]:
    yield
    if path := os.environ.get("DSNET_FAULTS_JSON"):
        made = provenance(0.0)
        result = {
            "seed": SEED,
            "size": "long" if LONG else "short",
            "machine": made["machine"],
            "finished_utc": made["finished_utc"],
            "counts": {fault: dict(sorted(one.items())) for fault, one in _counts.items()},
        }
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
