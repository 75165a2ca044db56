"""The comparison of aligners on three sequences of a third of a second."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.alignment import compare as compare_module
from benchmarks.alignment import compare_page
from benchmarks.alignment.compare import CompareConfig, compare
from benchmarks.alignment.contenders import Estimate, contenders
from benchmarks.alignment.known_sequences import Suite, known_sequences
from benchmarks.alignment.scores import Scores, loads_of
from tests.one_thread import one_thread as one_thread

# Motions begin at rest; a woman, a man, a woman again, since genders are aligned apart.
PAIRS = (("50004", "jiggle_on_toes"), ("50002", "one_leg_jump"), ("50020", "one_leg_jump"))
NAMES = [f"{subject}_{motion}" for subject, motion in PAIRS]
TINY = Suite("tiny", seed=3, pairs=PAIRS, frames=20)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("compare")


@pytest.fixture(scope="module")
def known(folder):
    return known_sequences(TINY, folder / "sequences")


def test_the_whole_comparison(folder, known, monkeypatch):
    """Aligners see one gender at a time, and each sequence gets its own estimate back."""
    truth = {o.recording.name: Estimate(o.betas.astype(np.float32), o.theta) for o in known}

    def true(data, recordings):
        assert len({data.gender, *(one.gender for one in recordings)}) == 1
        return lambda: [truth[one.name] for one in recordings]

    monkeypatch.setattr(compare_module, "draw_figures", lambda *_: None)
    monkeypatch.setattr(compare_module, "contenders", lambda *a: contenders(*a) | {"robust": true})
    names = ("robust_fast", "robust")
    config = CompareConfig(out=folder, contenders=names, rounds=1, threads=1)
    fast, exact = compare(config, TINY)["aligners"].values()
    assert list(exact["r2_of_sequence"]) == NAMES
    assert exact["r2_worst"] > 0.999
    assert fast["r2_worst"] == min(fast["r2_of_sequence"].values())
    assert fast["r2"] > 0.8


def scored(known, estimates) -> dict:
    scores = Scores()
    for one, estimate in zip(known, estimates, strict=True):
        scores.add(one, loads_of(one), estimate)
    return scores.summary()


def test_the_true_pose_loses_nothing(known):
    truth = [Estimate(one.betas.astype(np.float32), one.theta) for one in known]
    summary = scored(known, truth)
    # Meshes and body are float32 here and float64 there.
    assert summary["r2"] == pytest.approx(1.0, abs=1e-4)
    assert summary["r2_without_toes"] == pytest.approx(1.0, abs=1e-4)
    assert summary["pose_deg"]["p95"] < 1e-5
    assert summary["trans_mm"]["mean"] == 0.0
    assert abs(summary["absorption"]["whole"]["absorbed"]) < 1e-4
    assert all(abs(joint["absorbed"]) < 1e-9 for joint in summary["joints"].values())
    true_mm = 1e3 * np.concatenate([np.linalg.norm(o.offsets_m, axis=-1) for o in known]).mean()
    assert summary["residual_mm"]["mean"] == pytest.approx(true_mm, rel=0.05)


def test_the_committed_page_is_what_its_results_say():
    folder = Path(__file__).parents[3] / "docs" / "results" / "alignment"
    results = json.loads((folder / "compare_held_out.json").read_text())
    assert (folder / "compare_held_out.md").read_text() == compare_page.markdown(results)
