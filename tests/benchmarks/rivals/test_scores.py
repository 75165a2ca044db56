"""A toy rival on a forged run: its scores, and on whose clips."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.prediction.comparison_rivals import rival_path, with_rivals
from benchmarks.rivals import __main__ as command
from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.motion.splits import CELLS
from bridge.runs import Run
from tests.forged.artifacts import put

SEQUENCES = [
    MotionSequence("50004_one_leg_jump", "50004", "one_leg_jump", 0, 8, 60.0, "validation"),
    MotionSequence("50004_hips", "50004", "hips", 8, 8, 60.0),
    MotionSequence("50004_hips_take2", "50004", "hips_take2", 16, 9, 60.0, "test"),
    MotionSequence("50004_kicking", "50004", "kicking", 25, 9, 60.0, "test"),
    MotionSequence("99001_hips", "99001", "hips", 34, 9, 60.0, "test"),
    MotionSequence("99001_kicking", "99001", "kicking", 43, 9, 60.0, "test"),
]
ALIGNED, FRAMES = 16, 52
CONFIG = {"smpl": None, "aligner": "robust"}


class Halfway:
    """Makes half of the true offsets, which swing with the root's height."""

    name, label = "halfway", "Halfway"

    def __init__(self, code, body):
        self.code, self.seen = code, []

    def choose(self, clips):
        self.seen = list(clips)
        (clip,) = clips
        np.testing.assert_allclose(clip.offsets_m, swing_m(clip.theta), atol=1e-7)
        return ["half of it"]

    def offsets_m(self, betas, theta, fps):
        assert self.seen
        assert fps == 60.0
        return 0.5 * swing_m(theta)


def swing_m(theta):
    shape = 2e-3 * np.cos(4 * load_body_model("embedded:female").v_template)
    return (theta[:, 67, None, None] * shape).astype(np.float32)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Truth, alignment and motions of four cells."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    monkeypatch.setattr(command, "body_model_path", lambda run: "embedded:female")
    monkeypatch.setitem(command.RIVALS, "halfway", Halfway)
    rng = np.random.default_rng(0)
    theta = np.zeros((FRAMES, 69), np.float32)
    theta[:, 67] = rng.normal(size=FRAMES).cumsum() / 20
    betas, offsets = rng.normal(size=(2, 10)).astype(np.float32), swing_m(theta)
    put(
        Run("toy").path / "truth",
        {"theta": theta, "betas": betas, "offsets": offsets},
        SEQUENCES,
        config=CONFIG,
    )
    aligned = {"theta": theta[:ALIGNED], "betas": betas[:1], "offsets": offsets[:ALIGNED]}
    aligned["frame_error"] = np.zeros(ALIGNED, np.float32)
    put(Run("toy").path / "align", aligned, SEQUENCES[:2], config=CONFIG)
    put(Run("toy").path / "infer_plus", {"theta": theta, "betas": betas}, SEQUENCES, config=CONFIG)
    return tmp_path


def test_a_rival_is_scored_in_the_four_cells_on_the_clips_of_the_comparison(run):
    found = command.main(command.RivalsConfig("halfway", run, "toy", run / "out"))
    assert found == json.loads(rival_path(run / "out", "own", "halfway").read_text())
    for cell in CELLS:
        assert found["cells"][cell]["halfway"]["r2"] == pytest.approx(0.75, abs=1e-5)
    assert [one["name"] for one in found["sequences"]] == [s.name for s in SEQUENCES[2:]]
    other = {"corpus": "own", "seed": 0, "test_bed": found["test_bed"], "sequences": []}
    with pytest.raises(DsnetError, match=r"halfway\.json with other sequences than own-0\.json"):
        with_rivals(run / "out", [other])
