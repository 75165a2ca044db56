"""The comparison of aligners on three sequences of a third of a second."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.alignment import compare_page, peer_smplfitter
from benchmarks.alignment.compare import CompareConfig, compare
from benchmarks.alignment.contenders import TITLES, Estimate, contenders
from benchmarks.alignment.known_sequences import HELD_OUT, TUNING, Suite, known_sequences
from benchmarks.alignment.peer_smplfitter import body_fitter, first_frame_shape
from benchmarks.alignment.scores import Scores, body_of, loads_of, moved_by_toes
from bridge import DsnetError
from bridge.body.posing import pose_vertices
from bridge.motion import unpack_theta
from tests.one_thread import one_thread as one_thread
from torch_align_ae.alignment.sgd import Descent

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


@pytest.fixture
def rough_regressor(monkeypatch):
    """The body's own regressor, in place of one that takes seconds to fit."""
    body_fitter.cache_clear()
    monkeypatch.setattr(
        peer_smplfitter, "posed_joint_regressor", lambda data: data.J_regressor.toarray()
    )
    yield
    body_fitter.cache_clear()


def test_the_whole_comparison(folder, known, rough_regressor):
    names = ("sgd", "smplfitter_known_shape_3", "robust_fast")
    config = CompareConfig(
        out=folder,
        contenders=names,
        rounds=1,
        threads=1,
        steps=2,
        first_frame_steps=40,
        shape_steps=40,
        panel_px=48,
    )
    compare(config, TINY)
    results = json.loads((folder / "compare_tiny.json").read_text())
    assert results["data"] == "synthetic"
    assert tuple(results["aligners"]) == names
    for aligner in results["aligners"].values():
        assert list(aligner["r2_of_sequence"]) == NAMES
        assert aligner["r2_worst"] == min(aligner["r2_of_sequence"].values())
        assert np.isfinite(aligner["offsets"]["mean_mm"])
    table = (folder / "compare_tiny.md").read_text()
    assert "synthetic" in table.splitlines()[0]
    assert table.count("\n| ") == 2 + len(names)
    error_mm = results["aligners"]["sgd"]["offsets"]["mean_mm"]
    assert f"| {TITLES['sgd']} |" in table
    assert f"| {error_mm:.2f} |" in table
    drawn = {path.name for path in folder.glob("*.png")}
    assert drawn == {"absorption_tiny.png", "absorption_body_tiny.png", "figure10_tiny.png"}


def test_every_sequence_gets_its_own_estimate(folder, known, monkeypatch):
    """Aligners see one gender at a time; the results are put back in order."""
    truth = {o.recording.name: Estimate(o.betas.astype(np.float32), o.theta) for o in known}

    def make(data, recordings):
        assert len({data.gender, *(one.gender for one in recordings)}) == 1
        return lambda: [truth[one.name] for one in recordings]

    monkeypatch.setattr("benchmarks.alignment.compare.contenders", lambda *_: {"robust": make})
    monkeypatch.setattr("benchmarks.alignment.compare.draw_figures", lambda *_: None)
    results = compare(CompareConfig(out=folder, contenders=("robust",), threads=1), TINY)
    robust = results["aligners"]["robust"]
    assert robust["r2_worst"] > 0.999
    assert len(robust["seconds"]) == 3
    assert robust["frames_per_s"] == pytest.approx(60 / np.median(robust["seconds"]))


def test_sequences_are_simulated_once(folder, known, monkeypatch):
    monkeypatch.setattr(
        "benchmarks.alignment.known_sequences._simulate", lambda *_: pytest.fail("again")
    )
    for one, again in zip(known, known_sequences(TINY, folder / "sequences"), strict=True):
        np.testing.assert_array_equal(one.recording.meshes_m, again.recording.meshes_m)


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


def test_a_translation_that_follows_the_offsets_is_found_out(known):
    one = known[0]
    theta = one.theta.copy()
    # As the body has turned them.
    theta[:, 66:] += 2 * loads_of(one).force / one.offsets_m.shape[1]
    summary = scored([one], [Estimate(one.betas.astype(np.float32), theta)])
    taken = summary["joints"].pop("translation")["absorbed"]
    whole = summary["absorption"]["whole"]
    assert taken > 0.01
    assert whole["absorbed"] == pytest.approx(taken, rel=0.01)
    assert all(abs(joint["absorbed"]) < 1e-9 for joint in summary["joints"].values())


def test_an_error_of_the_toes_shows_in_one_column_only(known):
    one = known[0]
    theta = one.theta.copy()
    theta[:, 3 * 10] += 0.5
    summary = scored([one], [Estimate(one.betas.astype(np.float32), theta)])
    assert summary["r2"] < 0.9
    assert summary["r2_without_toes"] > 0.999
    assert 200 < moved_by_toes().sum() < 1000


def test_the_peer_is_given_a_fair_chance(known, tmp_path):
    """More iterations do not make smplfitter worse, and it finds the shape of a body at rest."""
    one = known[0]
    fitter = body_fitter(body_of(one.recording.gender))
    # Its lowered arms hang as the scanned ones did not, and no fitter could tell that from shape.
    pose, trans = unpack_theta(one.theta[:1].astype(np.float64))
    without_tissue = pose_vertices(body_of(one.recording.gender), one.betas[None], pose, trans)[0]
    betas = first_frame_shape(fitter, torch.tensor(without_tissue, dtype=torch.float32))
    np.testing.assert_allclose(betas, one.betas, atol=0.02)
    makers = contenders(Descent(steps=1, first_frame_steps=1, shape_steps=1), tmp_path)
    r2 = {}
    for iterations in (3, 10):
        align = makers[f"smplfitter_known_shape_{iterations}"]
        summary = scored([one], align(body_of(one.recording.gender), [one.recording])())
        r2[iterations] = summary["r2_without_toes"]
    assert r2[10] > r2[3] - 0.05


def test_nobody_tunes_on_what_is_held_out():
    assert not {subject for subject, _ in TUNING.pairs} & {s for s, _ in HELD_OUT.pairs}
    assert not {motion for _, motion in TUNING.pairs} & {m for _, m in HELD_OUT.pairs}
    assert TUNING.seed != HELD_OUT.seed


def test_an_unknown_contender_is_refused(tmp_path):
    with pytest.raises(DsnetError, match="smplify"):
        compare(CompareConfig(out=tmp_path / "new", contenders=("smplify",)), TINY)
    assert not (tmp_path / "new").exists()


def test_the_committed_page_is_what_its_results_say():
    folder = Path(__file__).parents[3] / "docs" / "results" / "alignment"
    results = json.loads((folder / "compare_held_out.json").read_text())
    assert (folder / "compare_held_out.md").read_text() == compare_page.markdown(results)
