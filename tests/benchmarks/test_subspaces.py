"""The comparison of subspaces on a mesh of 40 vertices: its numbers, and its published page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from benchmarks.subspaces.comparison import SubspacesConfig, main
from benchmarks.subspaces.page import markdown
from bridge.motion import MotionSequence
from bridge.motion.splits import split_frames
from bridge.runs import Run
from tests.forged.artifacts import put

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "subspaces"
VERTICES = 40


def leave_run() -> np.ndarray:
    """A run with one alignment of three clips, of which the last is held out; its offsets."""
    clips = (("hips", 0, 60), ("kicking", 60, 60), ("one_leg_jump", 120, 30))
    splits = ("train", "train", "validation")
    index = [
        MotionSequence(f"50004_{motion}", "50004", motion, start, length, 60.0, split)
        for (motion, start, length), split in zip(clips, splits, strict=True)
    ]
    rng = np.random.default_rng(0)
    swings = np.sin(rng.uniform(0.1, 0.9, 20) * np.arange(150)[:, None]) * 0.8 ** np.arange(20)
    offsets_m = 5e-3 * (swings @ rng.standard_normal((20, VERTICES * 3)))
    offsets_m = offsets_m.reshape(150, VERTICES, 3).astype(np.float32)
    aligned = Run("r").path / "align_robust"
    put(aligned, {"offsets": offsets_m}, index, config={"aligner": "robust"})
    return offsets_m


def test_pca_has_the_errors_of_a_plain_singular_value_decomposition(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    offsets_m = leave_run()
    main(
        SubspacesConfig(
            out=tmp_path / "out", run="r", codes=("pca", "residual"), sizes=(6,), steps=12,
            search_steps=4, rates=(1e-3, 1e-4), batch_size=16, validate_every=4,
            validation_frames=20,
        )
    )  # fmt: skip
    found, residual = (
        json.loads((tmp_path / "out" / f"{code}-6-0.json").read_text())
        for code in ("pca", "residual")
    )
    split = split_frames(np.arange(120), seed=0)
    flat = offsets_m.reshape(150, -1).astype(np.float64)
    mean = flat[split.train].mean(axis=0)
    right = np.linalg.svd(flat[split.train] - mean, full_matrices=False)[2][:6]
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
    np.testing.assert_allclose(residual["curve"]["r2"][0], found["scored_r2"],
                               rtol=1e-5)  # fmt: skip


def test_the_committed_page_is_made_of_the_committed_rows():
    assert (RESULTS / "subspaces.md").read_text() == markdown(RESULTS)
