"""The time of work that was begun several times."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from bridge.runs.work_time import WorkTime
from bridge.runs.writer import ArtifactWriter


def keep(path: Path, **kept: object) -> None:
    path.write_text(json.dumps(kept))


def written(path: Path, at: float) -> Path:
    """A file of a turn, last changed then."""
    path.touch()
    os.utime(path, (at, at))
    return path


def test_work_that_is_new_has_taken_nothing(tmp_path):
    assert WorkTime(tmp_path / "time.json", []).seconds < 10


def test_a_killed_turn_counts_to_the_last_file_that_it_wrote(tmp_path):
    path = tmp_path / "time.json"
    keep(path, before_s=100.0, begun=5000.0)
    made = [written(tmp_path / "a", 5007.0), written(tmp_path / "b", 5040.0), path]
    assert 140 <= WorkTime(path, made).seconds < 150
    assert 140 <= json.loads(path.read_text())["before_s"] < 141


def test_a_turn_that_wrote_nothing_counts_nothing(tmp_path):
    path = tmp_path / "time.json"
    keep(path, before_s=100.0, begun=5000.0)
    assert 100 <= WorkTime(path, [written(tmp_path / "of_before", 4000.0)]).seconds < 110


@pytest.mark.parametrize("text", ["", "[]", "{}", "null", '{"before_s": "x", "begun": 1}', "\xff"])
def test_a_damaged_file_stops_no_work(tmp_path, text):
    path = tmp_path / "time.json"
    path.write_bytes(text.encode("latin-1"))
    assert 0 <= WorkTime(path, []).seconds < 10


def test_an_artifact_tells_the_time_of_all_its_turns(tmp_path):
    begun = time.time()
    first = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    (first.checkpoints / "one").touch()
    for file in first.checkpoints.iterdir():
        os.utime(file, (begun + 60, begun + 60))
    second = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    second.put("x", np.zeros(3), "m")
    made = second.finish().manifest["provenance"]
    assert 55 < made["wall_time_s"] < 90


def test_other_work_in_the_same_place_begins_anew(tmp_path):
    first = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="a")
    written(first.checkpoints / "one", time.time() + 60)
    other = ArtifactWriter(tmp_path / "toy", "toy", data="synthetic", fingerprint="b")
    other.put("x", np.zeros(3), "m")
    assert other.finish().manifest["provenance"]["wall_time_s"] < 30
