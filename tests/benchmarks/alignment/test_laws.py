"""The robust aligner by law: the page is its numbers, and the worst sequence is found."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.alignment import laws
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Run, write_artifact

PAGE = Path(__file__).parents[3] / "docs" / "results" / "alignment" / "laws.md"


def test_the_committed_page_is_made_of_its_numbers():
    assert PAGE.read_text() == laws.markdown(PAGE.with_suffix(".json"))


def write(run: Run, kind: str, arrays: dict[str, np.ndarray], **record: Any) -> None:
    units = dict.fromkeys(arrays, "m")
    write_artifact(run.path / kind, kind, arrays, units=units, data="synthetic", **record)


def test_the_sequence_that_is_given_back_least_is_named(tmp_path, monkeypatch):
    """Two sequences in another order in the truth, one of which the aligner halves."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    run, frames = Run("bed"), 4
    names = ("50004_hips", "50004_punching")
    forward, backward = (
        to_manifest(
            MotionSequence(name, "50004", name[6:], frames * row, frames, 60.0)
            for row, name in enumerate(order)
        )
        for order in (names, names[::-1])
    )
    true_m = np.random.default_rng(0).normal(size=(2 * frames, 5, 3)).astype(np.float32)
    aligned_m = true_m.copy()
    aligned_m[frames:] /= 2
    config = {"tissue": "second", "form": "clean", "gender": "male"}
    turned_m = np.concatenate([true_m[frames:], true_m[:frames]])
    write(run, "corpus", {}, sequences=forward, config=config)
    write(run, "truth", {"offsets": turned_m}, sequences=backward)
    write(run, "align", {"offsets": aligned_m}, sequences=forward, aligner="robust")
    out = tmp_path / "laws.md"
    laws.main(laws.LawsConfig(out, ("bed",)))
    (row,) = (line for line in out.read_text().splitlines() if line.startswith("| `"))
    missed = np.square(true_m[frames:]).sum() / 4
    whole = 1 - missed / np.square(true_m).sum()
    assert row.split(" | ")[1:8] == [
        "second", "clean", "male", "2", f"{whole:.3f}", "0.750", "`50004_punching`",
    ]  # fmt: skip
    found = json.loads(out.with_suffix(".json").read_text())["runs"]["bed"]["sequences"]
    assert found == {"50004_hips": 1.0, "50004_punching": pytest.approx(0.75)}
