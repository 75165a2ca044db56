"""Errors of unseen motions, taken apart into what is slow and what is fast."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.unseen_motions import UnseenConfig, main
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Run, write_artifact

FRAMES, FPS = 120, 60.0
LEARNED = MotionSequence("50004_hips", "50004", "hips", 0, 5, FPS, "train")
UNSEEN = MotionSequence("99001_kicking", "99001", "kicking", 5, FRAMES, FPS, "test")
_SECONDS = np.arange(FRAMES)[:, None, None] / FPS
SWING_M = 1e-3 * np.sin(2 * np.pi * 5 * _SECONDS) * np.ones((1, 4, 3))


def leave_run(name: str, predicted_m: np.ndarray, sequences=(LEARNED, UNSEEN)) -> None:
    """A run whose unseen motion swings by a millimetre, five times a second."""
    before = np.zeros((LEARNED.length, 4, 3))
    truth = np.concatenate([before, SWING_M]).astype(np.float32)
    predicted = np.concatenate([before, predicted_m]).astype(np.float32)
    arrays = {
        "truth": {"offsets": truth},
        "decode": {"offsets_first": predicted, "offsets_second": 0 * predicted},
    }
    for stage, contents in arrays.items():
        write_artifact(
            Run(name).path / stage,
            stage,
            contents,
            units=dict.fromkeys(contents, "m"),
            data="synthetic",
            sequences=to_manifest(list(sequences)),
            predictors={"first": "First", "second": "Second"},
            default="first",
        )


@pytest.fixture(autouse=True)
def _runs(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))


def test_an_offset_that_follows_the_pose_is_told_from_a_swing(tmp_path):
    following_m = 4e-3 * np.cos(2 * np.pi * 0.5 * _SECONDS) * np.ones((1, 4, 3))
    leave_run("following", SWING_M + following_m)
    leave_run("halved", SWING_M / 2)
    out = tmp_path / "out"
    results = main(UnseenConfig(out, ("following", "halved")))
    following, halved = (results["runs"][name]["kicking"] for name in ("following", "halved"))
    assert following["first"]["r2"] < -10
    assert following["first"]["fast_r2"] > 0.99
    assert following["first"]["slow_share"] > 0.99
    assert following["first"]["mean_mm"] == pytest.approx(
        1e3 * np.linalg.norm(following_m, axis=-1).mean(), rel=1e-5
    )
    assert halved["first"]["r2"] == pytest.approx(0.75, abs=1e-6)
    assert halved["first"]["fast_r2"] == pytest.approx(0.75, abs=1e-6)
    assert halved["first"]["slow_share"] < 0.05
    assert halved["second"]["r2"] == pytest.approx(0)
    assert halved["true_mm"] == pytest.approx(1e3 * np.linalg.norm(SWING_M, axis=-1).mean())
    assert json.loads((out / "unseen_motions.json").read_text()) == results
    assert "| `following` | kicking |" in (out / "unseen_motions.md").read_text()
    assert (out / "unseen_motions.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "sequences", "words"),
    [
        ({"subject": "1"}, (LEARNED, UNSEEN), "one of 99001"),
        ({}, (LEARNED,), "without unseen motions"),
        ({"runs": ("unknown",)}, (LEARNED,), "unknown run"),
    ],
)
def test_what_cannot_be_shown_is_one_line(tmp_path, options, sequences, words):
    leave_run("any", SWING_M, sequences)
    with pytest.raises(DsnetError, match=words):
        main(UnseenConfig(tmp_path / "out", **{"runs": ("any",), **options}))
    assert not (tmp_path / "out").exists()
