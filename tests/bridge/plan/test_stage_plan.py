"""`dsnet plan`: the table, what is done already, the disk, and that nothing is made."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from bridge.cli import main
from bridge.motion import MotionSequence, to_manifest
from bridge.plan import stage_plan
from bridge.plan.costs import Work
from bridge.plan.stage_plan import PlannedStage, peak_bytes
from bridge.runs import ArtifactWriter
from tests.bridge.plan.test_costs import MATERIAL, SETTINGS


class Disk(NamedTuple):
    free: int


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in place of runs/, and stages that answer at once."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))

    def answer(module: str, *_arguments: str) -> str:
        torch_side = module.startswith("torch")
        sequences = to_manifest(MATERIAL.sequences) if torch_side else []
        return json.dumps({"settings": SETTINGS if torch_side else {}, "sequences": sequences})

    monkeypatch.setattr(stage_plan, "answer_of_module", answer)
    return tmp_path / "runs"


def rows(text: str) -> dict[str, str]:
    """The table's rows by stage."""
    return {line.split()[0]: line for line in text.splitlines() if re.match(r"[\w-]+  ", line)}


def finish(folder: Path, config: dict[str, Any], **upstream: str) -> None:
    writer = ArtifactWriter(folder, folder.name, data="synthetic")
    writer.finish(config=config, upstream=upstream)


def test_every_stage_has_a_row_and_nothing_is_made(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["plan", "--profile", "smoke"])
    found = rows(capsys.readouterr().out)
    assert list(found) == ["stage", *SETTINGS, "together"]
    assert "110 frames of 10 steps" in found["align"]
    assert not runs.exists()


def test_what_is_done_costs_nothing(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    finish(runs / "r" / "truth", {"form": "clean"})
    finish(runs / "r" / "corpus", {"form": "captured"}, truth="x")  # other settings
    finish(runs / "r" / "align", dict(SETTINGS["align"]), corpus="x")
    (runs / "r" / ".train-ae.partial").mkdir()
    before = sorted(runs.rglob("*"))
    main(["plan", "--profile", "smoke", "--run", "r"])
    found = rows(capsys.readouterr().out)
    assert found["truth"].split()[-4:] == ["-", "-", "-", "done"]
    assert not found["corpus"].endswith("done")
    assert not found["align"].endswith("done")  # what it is made of will be new
    assert found["train-ae"].endswith("begun")
    assert sorted(runs.rglob("*")) == before


@pytest.mark.parametrize(("free", "verdict"), [(10**7, "NOT ENOUGH"), (10**11, "enough")])
def test_the_disk_is_compared(
    runs: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    free: int,
    verdict: str,
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: Disk(free))
    main(["plan", "--profile", "smoke"])
    assert f": {verdict}." in capsys.readouterr().out


def test_without_the_robust_aligner_there_is_no_best_road(
    runs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(SETTINGS, "align_robust")
    main(["plan", "--profile", "smoke"])
    assert not {"train_plus", "predict_plus"} & set(rows(capsys.readouterr().out))


def test_the_most_on_the_disk_may_be_before_the_end() -> None:
    def stage(disk: int, scratch: int, state: str = "") -> PlannedStage:
        return PlannedStage("s", Work(1, "", disk, scratch), 1.0, 1, state)  # type: ignore[arg-type]

    assert peak_bytes([stage(10, 0), stage(1, 50), stage(20, 0)]) == 61
    assert peak_bytes([stage(10, 0), stage(1, 5), stage(20, 0)]) == 31
    assert peak_bytes([stage(10, 99, "done"), stage(1, 5)]) == 6


def test_motions_of_a_folder_replace_the_corpus_own(
    runs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    motion = MotionSequence("z_walk", "z", "walk", 0, 7, 60.0, "test")
    monkeypatch.setattr(stage_plan, "find_motion_files", lambda *_: [tmp_path])
    monkeypatch.setattr(stage_plan, "_motion", lambda _path, _fps: motion)
    main(["plan", "--profile", "smoke", "--amass", str(tmp_path)])
    assert "besides 1 motions, 7 frames" in capsys.readouterr().out
