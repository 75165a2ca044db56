"""What the autoencoder gains from the clip that it is judged on."""

from __future__ import annotations

import json

import pytest

from benchmarks.held_out import HeldOutConfig, main
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Run, write_artifact

INDEX = [
    MotionSequence("50004_hips", "50004", "hips", 0, 5, 60.0, "train"),
    MotionSequence("50004_one_leg_jump", "50004", "one_leg_jump", 5, 5, 60.0, "validation"),
]


def leave_run(comparisons: list[dict], r2_held_out: float | None = 0.8) -> None:
    scores = {"r2_validation": 0.9, "r2_held_out": r2_held_out}
    trained = {"steps_taken": 7, "preset": "short", **scores}
    aligned = write_artifact(
        Run("r").path / "align",
        "align",
        {},
        units={},
        data="synthetic",
        sequences=to_manifest(INDEX),
    )
    write_artifact(
        Run("r").path / "train-ae",
        "train-ae",
        {},
        units={},
        data="synthetic",
        config={"seed": 3},
        upstream={"align": aligned.content_sha256},
        autoencoder=trained,
        comparisons=comparisons,
        pca={"components": 100, **scores},
    )


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))


def test_both_ways_stand_side_by_side(tmp_path):
    leave_run([{"name": "all_frames", "r2_validation": 0.91, "r2_held_out": 0.85}])
    results = main(HeldOutConfig(tmp_path / "out", "r"))
    assert [row["r2_held_out"] for row in results["rows"]] == [0.8, 0.85, 0.8]
    assert json.loads((tmp_path / "out" / "held_out.json").read_text()) == results
    assert results["clips"] == "`50004_one_leg_jump`"
    assert (results["steps"], results["preset"], results["seed"]) == (7, "short", 3)
    assert results["data"] == "synthetic"


@pytest.mark.parametrize("comparisons", [[], [{"name": "literal"}]])
def test_a_run_without_the_comparison_is_refused(comparisons, tmp_path):
    leave_run(comparisons)
    with pytest.raises(DsnetError, match="--comparisons all_frames"):
        main(HeldOutConfig(tmp_path, "r"))


def test_a_run_that_holds_nothing_out_is_refused(tmp_path):
    leave_run([{"name": "all_frames", "r2_validation": 0.9, "r2_held_out": None}], None)
    with pytest.raises(DsnetError, match="without a held-out clip"):
        main(HeldOutConfig(tmp_path, "r"))
