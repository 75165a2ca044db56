"""A full or a read-only disk: one line, nothing half-written, and with room it goes on."""

from __future__ import annotations

import os
import random
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.conftest import LONG, SEED, Base
from tests.faults.stages import (
    ARTIFACTS,
    COMMANDS,
    RUN,
    check_as_undisturbed,
    finished,
    make,
    names_in,
)

pytestmark = pytest.mark.faults
FAULT = "disk"
FILLED = COMMANDS if LONG else ("corpus", "align", "train-ae")
READ_ONLY = COMMANDS if LONG else ("encode",)


class SmallDisk:
    """A file system in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def mount(self, options: str) -> None:
        """With `remount,`: change what is there."""
        command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(self.folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"no file system can be mounted here: {done.stderr.strip()}")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    if os.geteuid() != 0:
        pytest.skip("only root mounts file systems")
    made = SmallDisk(tmp_path / "disk")
    made.folder.mkdir()
    made.mount("size=1m")
    yield made
    subprocess.run(["umount", "-l", str(made.folder)], check=True)


def sources_of(command: str, base: Base, runs: Path) -> None:
    """Links do not reach another disk: the stages that are read are symbolic ones."""
    (runs / RUN).mkdir()
    for source in (base.runs / RUN).iterdir():
        if source.name not in ARTIFACTS[command]:
            (runs / RUN / source.name).symlink_to(source)


def size_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("command", FILLED)
def test_a_full_disk_is_one_line_and_no_end(
    command: str, base: Base, disk: SmallDisk, tally: Counter[str]
) -> None:
    rng = random.Random(f"{SEED} {command}")
    wanted = sum(size_of(base.runs / RUN / name) for name in ARTIFACTS[command])
    disk.mount(f"remount,size={max(64, int(rng.uniform(0.1, 0.9) * wanted) >> 10)}k")
    sources_of(command, base, disk.folder)
    full = make(command, disk.folder)
    assert (full.status, len(full.lines)) == (2, 1), full.said
    assert "No space left on device" in full.said
    assert not finished(command, disk.folder)
    disk.mount("remount,size=2g")
    again = make(command, disk.folder)
    assert (again.status, again.lines) == (0, [])
    check_as_undisturbed(command, base.runs, disk.folder)
    tally["full: one line, went on with room"] += 1


@pytest.mark.parametrize("command", READ_ONLY)
def test_a_read_only_disk_is_one_line(
    command: str, base: Base, disk: SmallDisk, tally: Counter[str]
) -> None:
    sources_of(command, base, disk.folder)
    before = names_in(disk.folder / RUN)
    disk.mount("remount,ro")
    refused = make(command, disk.folder)
    assert (refused.status, len(refused.lines)) == (2, 1), refused.said
    assert str(disk.folder) in refused.said
    assert names_in(disk.folder / RUN) == before
    tally["read-only: one line"] += 1


def test_what_is_current_needs_no_writing(base: Base, disk: SmallDisk, tally: Counter[str]) -> None:
    disk.mount("remount,size=2g")
    copy_all = subprocess.run(["cp", "-r", base.runs / RUN, disk.folder / RUN], check=False)
    assert copy_all.returncode == 0
    disk.mount("remount,ro")
    ended = make("encode", disk.folder)
    assert (ended.status, ended.lines) == (0, [])
    tally["read-only: current, nothing to do"] += 1
