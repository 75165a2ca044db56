"""The robust aligner by law: what it gives back, over all sequences and of each."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.alignment import laws
from bridge.motion import MotionSequence
from bridge.runs import Run
from tests.forged.artifacts import put


def test_the_sequence_that_is_given_back_least_is_named(tmp_path, monkeypatch):
    """Two sequences in another order in the truth, one of which the aligner halves."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    run, frames = Run("bed"), 4
    names = ("50004_hips", "50004_punching")
    forward, backward = (
        [
            MotionSequence(name, "50004", name[6:], frames * row, frames, 60.0)
            for row, name in enumerate(order)
        ]
        for order in (names, names[::-1])
    )
    true_m = np.random.default_rng(0).normal(size=(2 * frames, 5, 3)).astype(np.float32)
    aligned_m = true_m.copy()
    aligned_m[frames:] /= 2
    config = {"tissue": "second", "form": "clean", "gender": "male"}
    turned_m = np.concatenate([true_m[frames:], true_m[:frames]])
    put(run.path / "corpus", {}, forward, config=config)
    put(run.path / "truth", {"offsets": turned_m}, backward)
    put(run.path / "align", {"offsets": aligned_m}, forward, config={"aligner": "robust"})
    out = tmp_path / "laws.json"
    laws.main(laws.LawsConfig(out, ("bed",)))
    found = json.loads(out.read_text())["runs"]["bed"]
    missed = np.square(true_m[frames:]).sum() / 4
    assert found["r2"] == pytest.approx(1 - missed / np.square(true_m).sum(), abs=1e-5)
    assert [found[key] for key in config] == list(config.values())
    assert found["sequences"] == {"50004_hips": 1.0, "50004_punching": pytest.approx(0.75)}
