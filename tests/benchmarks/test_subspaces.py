"""The comparison of subspaces on a mesh of 40 vertices: its numbers, its resumption, its page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.subspaces import comparison
from benchmarks.subspaces.codes import CODES
from benchmarks.subspaces.comparison import SubspacesConfig, main
from benchmarks.subspaces.page import markdown
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, to_manifest
from bridge.motion.splits import split_frames
from bridge.runs import Run, write_artifact
from torch_align_ae.autoencoder.training import Training

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "subspaces"
VERTICES = 40
LENGTHS = {"50004_hips": 60, "50004_kicking": 60, "50004_one_leg_jump": 30}
HELD_OUT = "50004_one_leg_jump"
SMALL = {"mesh": (30, 20, 16, 8), "casas_otaduy": (30, 20)}


def leave_run(held_out: str = HELD_OUT, name: str = "align_robust", seed: int = 0) -> np.ndarray:
    """A run with one alignment, whose offsets it returns."""
    starts = np.cumsum([0, *LENGTHS.values()])
    index = [
        MotionSequence(
            clip, "50004", clip[6:], int(start), length, 60.0,
            "validation" if clip == held_out else "train",
        )
        for start, (clip, length) in zip(starts, LENGTHS.items(), strict=False)
    ]  # fmt: skip
    rng = np.random.default_rng(seed)
    swings = np.sin(rng.uniform(0.1, 0.9, 20) * np.arange(150)[:, None]) * 0.8 ** np.arange(20)
    offsets_m = 5e-3 * (swings @ rng.standard_normal((20, VERTICES * 3)))
    offsets_m = offsets_m.reshape(150, VERTICES, 3).astype(np.float32)
    write_artifact(
        Run("r").path / name,
        name,
        {"offsets": offsets_m},
        units={"offsets": "m"},
        data="synthetic",
        config={"aligner": "robust" if name == "align_robust" else "sgd"},
        sequences=to_manifest(index),
    )
    return offsets_m


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch):
    """Runs in a folder of the test's own, and networks for a mesh of 40 vertices."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    for name, code in CODES.items():
        monkeypatch.setitem(CODES, name, replace(code, widths=SMALL.get(code.kind, code.widths)))


def config_of(tmp_path: Path, *codes: str, **changes) -> SubspacesConfig:
    base = SubspacesConfig(
        out=tmp_path / "out", run="r", codes=codes or tuple(CODES), sizes=(6,), steps=12,
        search_steps=4, rates=(1e-3, 1e-4), batch_size=16, validate_every=4, validation_frames=20,
    )  # fmt: skip
    return replace(base, **changes)


def row(tmp_path: Path, code: str, size: int = 6) -> dict:
    return json.loads((tmp_path / "out" / f"{code}-{size}-0.json").read_text())


def test_every_code_has_its_row(tmp_path):
    leave_run()
    results = main(config_of(tmp_path))
    assert results["rows"] == [f"{code}-6-0.json" for code in CODES]
    page = (tmp_path / "out" / "subspaces.md").read_text()
    assert page == markdown(tmp_path / "out")
    assert "synthetic" in page.splitlines()[0]
    for code in CODES:
        found = row(tmp_path, code)
        scores = found["validation"]
        assert f"| {found['label']} | 6 | {found['parameters']:,} | {scores['r2']:.4f} |" in page
        assert scores["mean_mm"] < scores["p95_mm"] <= scores["max_mm"]
        assert set(found["decode_ms"]) == {"1", "64"}
        if code != "pca":
            assert found["curve"]["steps"] == [0, 4, 8, 12]
            assert found["steps_taken"] == found["timed_steps"] == 12
            assert found["step_s"] > 0
    assert (tmp_path / "out" / "subspaces.png").stat().st_size > 10_000
    assert not list((tmp_path / "out" / ".checkpoints").iterdir())


def test_pca_has_the_errors_of_a_plain_singular_value_decomposition(tmp_path):
    offsets_m = leave_run()
    main(config_of(tmp_path, "pca", "residual"))
    split = split_frames(np.arange(120), seed=0)
    flat = offsets_m.reshape(150, -1).astype(np.float64)
    mean = flat[split.train].mean(axis=0)
    right = np.linalg.svd(flat[split.train] - mean, full_matrices=False)[2][:6]
    found = row(tmp_path, "pca")
    for key, frames in (("validation", split.validation), ("held_out", np.arange(120, 150))):
        error = (flat[frames] - mean) @ right.T @ right + mean - flat[frames]
        distance_mm = 1e3 * np.linalg.norm(error.reshape(-1, 3), axis=1)
        expected = {
            "r2": 1 - np.square(error).sum() / np.square(flat[frames]).sum(),
            "mean_mm": distance_mm.mean(),
            "max_mm": distance_mm.max(),
        }
        for name, value in expected.items():
            np.testing.assert_allclose(found[key][name], value, rtol=1e-4)
        np.testing.assert_allclose(found[key]["p95_mm"], np.quantile(distance_mm, 0.95), atol=0.02)
    # The residual autoencoder's curve begins at PCA's line, in metres, on the scored frames.
    np.testing.assert_allclose(row(tmp_path, "residual")["curve"]["r2"][0], found["scored_r2"],
                               rtol=1e-5)  # fmt: skip


@pytest.mark.parametrize("code", ["mesh_measured", "mesh_literal", "casas_otaduy"])
def test_a_curve_ends_where_the_scores_are(tmp_path, code):
    leave_run()
    main(config_of(tmp_path, code, validation_frames=1000))
    found = row(tmp_path, code)
    best = found["curve"]["steps"].index(found["best_step"])
    np.testing.assert_allclose(found["curve"]["r2"][best], found["validation"]["r2"], atol=1e-5)


class _KilledError(Exception):
    pass


def _kill_after(monkeypatch, steps: int) -> None:
    """Kill the process when so many steps have been taken, in whichever training."""
    train, taken = Training._train, []

    def dies(self, upto, bar):
        taken.extend(upto)
        if len(taken) > steps:
            raise _KilledError
        return train(self, upto, bar)

    monkeypatch.setattr(Training, "_train", dies)


@pytest.mark.parametrize("steps", [5, 8, 16])
def test_a_killed_comparison_goes_on(tmp_path, monkeypatch, steps):
    leave_run()
    main(config_of(tmp_path, "pca", "residual"))
    whole = row(tmp_path, "residual")
    (tmp_path / "out").rename(tmp_path / "whole")
    with monkeypatch.context() as patch:
        _kill_after(patch, steps)
        with pytest.raises(_KilledError):
            main(config_of(tmp_path, "pca", "residual"))
    assert not (tmp_path / "out" / "residual-6-0.json").exists()
    assert "| PCA | 6 |" in (tmp_path / "out" / "subspaces.md").read_text()
    with monkeypatch.context() as patch:
        # Two searches of 4 steps and a training of 12, in pieces of 4, less what was done.
        _kill_after(patch, 20 - steps // 4 * 4)
        main(config_of(tmp_path, "pca", "residual"))
    found = row(tmp_path, "residual")
    for key in ("validation", "held_out", "curve", "searched", "learning_rate", "best_step"):
        assert found[key] == whole[key], key


def test_finished_rows_are_kept(tmp_path, monkeypatch):
    leave_run()
    main(config_of(tmp_path, "residual"))
    before = (tmp_path / "out" / "residual-6-0.json").read_bytes()
    _kill_after(monkeypatch, 0)
    main(config_of(tmp_path, "pca", "residual"))
    assert (tmp_path / "out" / "residual-6-0.json").read_bytes() == before
    results = main(config_of(tmp_path, "pca", sizes=(4, 6)))
    assert results["rows"] == ["pca-4-0.json", "pca-6-0.json", "residual-6-0.json"]


def test_the_rate_of_the_least_loss_is_taken(tmp_path):
    leave_run()
    main(config_of(tmp_path, "casas_otaduy", rates=(1e-6, 1e-3, 1e-5)))
    found = row(tmp_path, "casas_otaduy")
    assert list(found["searched"]) == ["1e-06", "0.001", "1e-05"]
    least = min(found["searched"], key=found["searched"].get)
    assert found["learning_rate"] == 1e-3 == float(least)


def test_a_rate_that_diverges_is_not_taken(tmp_path):
    leave_run()
    main(config_of(tmp_path, "casas_otaduy", rates=(1e30, 1e-4)))
    found = row(tmp_path, "casas_otaduy")
    assert found["searched"]["1e+30"] is None
    assert found["learning_rate"] == 1e-4
    with pytest.raises(DsnetError, match=r"diverges at 1e\+30.*--rates"):
        main(config_of(tmp_path, "casas_otaduy", out=tmp_path / "other", rates=(1e30,)))


def test_the_papers_rows_keep_the_papers_rate(tmp_path):
    leave_run()
    main(config_of(tmp_path, "mesh_literal", "mesh_measured"))
    for code in ("mesh_literal", "mesh_measured"):
        found = row(tmp_path, code)
        assert (found["learning_rate"], found["searched"]) == (1e-4, {})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"codes": ("pca", "wavelets")}, "wavelets"),
        ({"codes": ()}, r"\(none\)"),
        ({"sizes": (0,)}, "--sizes 0"),
        ({"sizes": (25, 101)}, "25 101.*1 to the paper's 100"),
        ({"sizes": ()}, "at least one"),
        ({"rates": ()}, "0 --rates"),
        ({"rates": (0.0,)}, "--rates 0"),
        ({"steps": 0}, "--steps 0"),
        ({"run": "missing"}, "run 'missing' without"),
    ],
)
def test_what_makes_no_sense_is_one_line(tmp_path, changes, message):
    leave_run()
    with pytest.raises(DsnetError, match=message) as caught:
        main(config_of(tmp_path, **changes))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 24}, "with steps 12; expected steps 24"),
        ({"seed": 1}, "with seed 0; expected seed 1"),
        ({"split": "sequence"}, "with split frame; expected split sequence"),
        ({"alignment": "align"}, "alignment align_robust, aligner robust, offsets"),
    ],
)
def test_results_of_other_settings_are_refused(tmp_path, changes, message):
    leave_run()
    leave_run(name="align", seed=1)
    main(config_of(tmp_path, "pca"))
    with pytest.raises(DsnetError, match=message):
        main(config_of(tmp_path, "pca", **changes))
    (tmp_path / "out" / "subspaces.json").unlink()
    with pytest.raises(DsnetError, match=message):
        main(config_of(tmp_path, "pca", **changes))


def test_results_of_a_run_that_was_made_again_are_refused(tmp_path):
    leave_run()
    main(config_of(tmp_path, "pca"))
    leave_run(seed=1)
    with pytest.raises(DsnetError, match=r"with offsets \w+; expected offsets"):
        main(config_of(tmp_path, "pca"))


def test_without_a_held_out_sequence_its_columns_are_empty(tmp_path):
    leave_run(held_out="")
    main(config_of(tmp_path, "pca"))
    assert row(tmp_path, "pca")["held_out"] is None
    line = next(x for x in markdown(tmp_path / "out").splitlines() if x.startswith("| PCA"))
    assert [cell.strip() for cell in line.split("|")[6:8]] == ["", ""]


def test_one_process_at_a_time(tmp_path):
    leave_run()
    config = config_of(tmp_path, "pca")
    with (
        comparison.exclusive(config.out, "the folder", "Wait."),
        pytest.raises(DsnetError, match="another process"),
    ):
        main(config)


@pytest.mark.skipif(not RESULTS.is_dir(), reason="no results are committed yet")
def test_the_committed_page_is_made_of_the_committed_rows():
    assert (RESULTS / "subspaces.md").read_text() == markdown(RESULTS)


def test_a_longer_training_in_the_folder_follows_its_row(tmp_path):
    leave_run()
    main(config_of(tmp_path, "pca", "residual"))
    main(config_of(tmp_path, "residual", out=tmp_path / "out" / "longer", steps=16))
    rows = [x for x in markdown(tmp_path / "out").splitlines() if x.startswith("| ")][1:]
    steps = [row.split(" | ")[8].partition(" ")[0] for row in rows]
    assert steps == ["", "12", "16"]
