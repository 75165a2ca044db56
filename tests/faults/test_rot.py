"""One byte changed anywhere: it is named before it is used, or it says the same."""

from __future__ import annotations

import json
import random
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.errors import DsnetError
from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.files import MANIFEST
from tests.faults.conftest import LONG, SEED, Base, asked
from tests.faults.stages import (
    ARTIFACTS,
    COMMANDS,
    RUN,
    Stage,
    check_as_undisturbed,
    copy_before,
    copy_linked,
    make,
)

pytestmark = pytest.mark.faults
FAULT = "rot"
READ_BY = {
    "corpus": "align",
    "truth": "evaluate",
    "align": "train-ae",
    "align_robust": "train",
    "train-ae": "encode",
    "encode": "train",
    "train": "infer",
    "train_plus": "infer",
    "infer": "decode",
    "decode": "evaluate",
    "infer_plus": "evaluate",
    "evaluate": "report",
}
READ = READ_BY if LONG else ("encode", "infer_plus")
RESUMED = COMMANDS[:-4] if LONG else ("align", "train")


def flip(path: Path, rng: random.Random) -> None:
    """Change one bit of a file, which has links elsewhere, in a copy of its own."""
    content = bytearray(path.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.unlink()
    path.write_bytes(content)


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.stat().st_size)


def read_all(artifact: Artifact) -> None:
    """As stages do: whatever they read, they get from these two."""
    for name in artifact.manifest["arrays"]:
        artifact.array(name)
    for name in artifact.manifest["files"]:
        artifact.file(name)


def test_a_changed_byte_is_named_or_says_the_same(
    base: Base, tmp_path: Path, tally: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In every file of the run at least once."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    rng = random.Random(SEED)
    files = [path.relative_to(base.runs / RUN) for path in files_of(base.runs / RUN)]
    drawn = [rng.choice(files) for _ in range(asked("FLIPS", 120) - len(files))]
    for file in (*files, *drawn):
        stage, path = file.parts[0], tmp_path / RUN / file
        copy_linked(base.runs / RUN / stage, tmp_path / RUN / stage)
        flip(path, rng)
        try:
            read_all(Run(RUN).artifact(stage))
            outcome = "same" if _says_the_same(path, base.runs / RUN / file) else "silent"
        except DsnetError as error:
            outcome = "named" if str(path) in str(error) else "silent"
        tally[f"finished: {outcome}"] += 1
        assert outcome != "silent", file
        shutil.rmtree(tmp_path / RUN)


def _says_the_same(path: Path, undisturbed: Path) -> bool:
    """Of a manifest all values count, and where it lies the white space between them does not."""
    if path.name != MANIFEST:
        return False
    found, expected = (json.loads(one.read_text()) for one in (path, undisturbed))
    # Without its own digest a provenance is taken as it is; all that it covers has to be there.
    del expected["provenance"]["sha256"]
    covered = {key: found["provenance"].get(key) for key in expected["provenance"]}
    return {**found, "provenance": covered} == expected


@pytest.mark.parametrize("stage", READ)
def test_the_next_stage_names_the_file(
    stage: str, base: Base, tmp_path: Path, tally: Counter[str]
) -> None:
    reader, rng = READ_BY[stage], random.Random(f"{SEED} {stage}")
    copy_before(reader, base.runs, tmp_path)
    path = rng.choice([p for p in files_of(tmp_path / RUN / stage) if p.name != MANIFEST])
    flip(path, rng)
    ended = make(reader, tmp_path)
    if ended.status == 0:
        check_as_undisturbed(reader, base.runs, tmp_path)
        tally["next stage: not read"] += 1
        return
    assert (ended.status, len(ended.lines)) == (2, 1), ended.said
    assert str(path) in ended.said
    for made in (tmp_path / RUN / name for name in ARTIFACTS[reader]):
        assert not made.exists() or stage not in read_artifact(made).manifest["upstream"]
    tally["next stage: named"] += 1


def _cut_files(command: str, base: Base, runs: Path, rng: random.Random) -> Iterator[Path]:
    """What a stage that was killed late leaves in its partial folder."""
    copy_before(command, base.runs, runs)
    share = rng.uniform(0.5, 0.9)
    Stage(command, runs, 1 + int(share * base.file_operations[command])).end()
    for partial in (runs / RUN).glob(".*.partial"):
        yield from files_of(partial)


@pytest.mark.parametrize("command", RESUMED)
@pytest.mark.parametrize("kind", ["checkpoint", "array"])
def test_a_damaged_partial_changes_nothing(
    command: str, kind: str, base: Base, tmp_path: Path, tally: Counter[str]
) -> None:
    rng = random.Random(f"{SEED} {command} {kind}")
    files = [
        path
        for path in _cut_files(command, base, tmp_path, rng)
        if {"checkpoint": "checkpoints", "array": "made"}[kind] in path.parts
    ]
    if not files:
        pytest.skip(f"{command} was cut before it had left a {kind}")
    flip(rng.choice(files), rng)
    again = make(command, tmp_path)
    assert again.status == 0, again.said
    assert "Traceback" not in again.said
    check_as_undisturbed(command, base.runs, tmp_path)
    tally["partial: named, made again" if "damaged" in again.said else "partial: same"] += 1
