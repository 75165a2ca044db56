"""The list of checks: complete, at the paper's sizes, and on a run's own weights."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.exchange import save_weights
from bridge.exchange.engine import load_tensors
from bridge.motion import MotionSequence
from bridge.runs import ArtifactWriter, Run
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.verify import draws
from dsnet.verify.checks import full_size_checks
from dsnet.verify.compare import verify
from dsnet.verify.draws import SMALL_WIDTHS
from dsnet.verify.trained_checks import trained_checks
from tests.forged.artifacts import put
from tests.forged.plus import write_plus


def test_names_are_unique_and_all_numbers_are_float32(checks):
    assert max(Counter(check.name for check in checks).values()) == 1
    arrays = [a for check in checks for a in (*check.weights.values(), *check.inputs.values())]
    assert {array.dtype for array in arrays} == {np.dtype(t) for t in (np.float32, np.int32, bool)}


def test_the_reference_answers_each_check_once_and_in_float64(checks):
    asked = Counter((check.name, dtype) for check in checks for dtype in check.precisions("numpy"))
    computed = {(check.name, "float64") for check in checks}
    assert asked == dict.fromkeys(computed, 1)


def test_clips_are_padded_and_have_a_mask_that_knows():
    clips = draws.clips(0, 4, 30)
    assert not clips["real"].all()
    assert clips["real"][0].all()
    for name in ("motion", "latents"):
        assert not clips[name][~clips["real"]].any()
        assert clips[name][clips["real"]].all()


@pytest.mark.slow
def test_the_full_size_is_the_whole_network():
    checks = full_size_checks(0)
    for check in checks:
        network = {n: w for n, w in check.weights.items() if not n.startswith("normaliser.")}
        assert sum(array.size for array in network.values()) == 33_626_606
    assert [check.op for check in checks] == [
        "ae_forward", "ae_train", "ae_train", "ae_decode"
    ]  # fmt: skip


@pytest.fixture
def trained_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run that has trained both networks, on a mesh of 40 vertices."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    rng, frames = np.random.default_rng(0), 30
    sequences = [
        MotionSequence("a_hop", "a", "hop", 0, 20, 60.0, "train"),
        MotionSequence("a_run", "a", "run", 20, 10, 60.0, "validation"),
    ]
    arrays = {
        "theta": rng.normal(size=(frames, 69)).astype(np.float32),
        "betas": rng.normal(size=(1, 10)).astype(np.float32),
        "latents": rng.normal(size=(frames, 100)).astype(np.float32),
        "offsets": rng.normal(scale=1e-3, size=(frames, 40, 3)).astype(np.float32),
    }
    for stage in ("align", "encode"):
        put(tmp_path / "r" / stage, arrays, sequences)
    train = ArtifactWriter(tmp_path / "r" / "train", "train", data="synthetic")
    sizes = {"input": 79, "latent": 100}
    scaling = {f"scaling/{k}_mean": rng.normal(size=n).astype(np.float32) for k, n in sizes.items()}
    for key, size in sizes.items():
        scaling[f"scaling/{key}_std"] = rng.uniform(0.5, 2, size).astype(np.float32)
    arrays = {"dsnet_standardised": scaling, "dsnet_faithful": {}}
    for name, scaled in arrays.items():
        weights = {**draws.dsnet_weights(1), **scaled}
        save_weights(train.file_path(f"{name}.safetensors"), weights)
    train.file_path("dsnet_faithful.keras").write_bytes(b"")
    train.record(default="dsnet_standardised", predictors={name: {} for name in arrays})
    train.finish()
    codec = ArtifactWriter(tmp_path / "r" / "train-ae", "train-ae", data="synthetic")
    weights = {f"model.{n}": a for n, a in draws.autoencoder_weights(1, SMALL_WIDTHS).items()}
    weights["normaliser.mean_m"] = rng.normal(scale=1e-3, size=(40, 3)).astype(np.float32)
    weights["normaliser.scale_m"] = np.full((40, 3), 2e-3, np.float32)
    save_weights(codec.file_path("autoencoder.safetensors"), weights)
    codec.record(architecture={"widths": SMALL_WIDTHS})
    codec.finish()
    return Run("r")


def test_a_runs_own_weights_are_checked(trained_run, tmp_path, run_reference):
    checks = trained_checks(trained_run)
    of_dsnet = {f"dsnet_{op}" for op in ("forward", "stream", "exported", "train")}
    assert {check.op for check in checks} == of_dsnet | {"ae_forward", "ae_train"}
    saved = [check.options["saved"] for check in checks if check.op == "dsnet_exported"]
    assert saved == [str(trained_run.artifact("train").file("dsnet_faithful.keras"))] * 3
    rows, answers = verify(checks, tmp_path / "work", run=run_reference)
    assert all(row.passed for row in rows)
    assert {row.engine for row in rows} == {"torch", "keras", "stream"}
    names = list(load_tensors(answers["numpy"].folder / "ae-trained.float64.safetensors"))
    assert (names[0], names[-1]) == ("layer/normaliser.normalise", "layer/normaliser.denormalise")
    (clips,) = [check.inputs for check in checks if check.name == "dsnet-faithful-training"]
    np.testing.assert_array_equal(clips["real"].sum(axis=1), [10, 20])


def test_a_run_without_networks_has_no_checks_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    assert trained_checks(Run("none")) == []


def test_graphs_of_a_runs_own_predictors_are_checked(tmp_path, monkeypatch, run_reference):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    rng, body = np.random.default_rng(1), load_body_model("embedded:female")
    arrays = {
        "theta": rng.normal(0, 0.2, (40, 69)).astype(np.float32),
        "betas": rng.normal(size=(2, 10)).astype(np.float32),
    }
    put(tmp_path / "r" / "align", arrays, config={"smpl": "embedded:female"})
    write_plus(Run("r"), TrainedPlus.from_arrays(draws.tissue(0, body)))
    checks = trained_checks(Run("r"))
    assert [check.op for check in checks] == ["plus_graph"]
    (row,), answers = verify(checks, tmp_path / "work", run=run_reference)
    assert row.passed
    answer = answers["numpy"].folder / "plus-graph-trained.float64.safetensors"
    assert list(load_tensors(answer)) == ["layer/vertices"]
