"""A small finished run, forged with every stage's layout: real sizes, few frames."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.exchange import save_weights
from bridge.motion import MotionSequence
from bridge.runs import ArtifactWriter, Run
from dsnet.report import stage_report
from tests.forged.artifacts import put

ALIGNED = [
    MotionSequence("50004_one_leg_jump", "50004", "one_leg_jump", 0, 9, 60.0, "validation"),
    MotionSequence("50004_hips", "50004", "hips", 9, 7, 60.0),
    MotionSequence("50020_jiggle_on_toes", "50020", "jiggle_on_toes", 16, 6, 60.0),
]
TEST = [
    MotionSequence("50004_kicking", "50004", "kicking", 22, 4, 60.0, "test"),
    MotionSequence("99001_kicking", "99001", "kicking", 26, 8, 60.0, "test"),
]
ALL = [*ALIGNED, *TEST]
FRAMES, ALIGNED_FRAMES = 34, 22
PREDICTORS = {"dsnet_small": "DSNet, small", "dsnet_other": "DSNet, other"}


def offsets_of(rng: np.random.Generator, frames: int, size_m: float) -> np.ndarray:
    """Smooth offsets: a few modes of low frequency over the body's height."""
    height = load_body_model("embedded:female").v_template[:, 1]
    waves = np.stack([np.cos(k * 4 * height) for k in range(1, 4)])
    amplitude = rng.normal(size=(frames, 3, 3)) * size_m
    return np.einsum("tkx,kv->tvx", amplitude, waves).astype(np.float32)


def forge_motion(rng: np.random.Generator) -> np.ndarray:
    theta = 0.1 * rng.normal(size=(FRAMES, 69))
    theta[:, 3 * 16 + 2], theta[:, 3 * 17 + 2] = -1.1, 1.1  # arms down
    theta[:, :3] = theta[:, 66:] = 0.0
    theta[:, 67] = 0.9 + 0.1 * np.sin(np.arange(FRAMES))
    return theta.astype(np.float32)


def forge_run(root: Path) -> Path:
    """Write all stages before `evaluate` below `root`; shapes and poses are found with errors."""
    rng = np.random.default_rng(0)
    truth = offsets_of(rng, FRAMES, 4e-3)
    aligned = truth[:ALIGNED_FRAMES] + offsets_of(rng, ALIGNED_FRAMES, 1e-3)
    theta, betas = forge_motion(rng), rng.normal(size=(3, 10)).astype(np.float32)
    found_betas, found_theta = betas.copy(), theta.copy()
    found_betas[:2] += np.float32(0.1)
    found_theta[:ALIGNED_FRAMES] += np.float32(0.01)
    _forge_corpus(root)
    put(
        root / "truth",
        {"theta": theta, "betas": betas, "offsets": truth},
        ALL,
        config={"seed": 0},
    )
    fitted = {
        "theta": found_theta[:ALIGNED_FRAMES],
        "betas": found_betas[:2],
        "offsets": aligned,
        "frame_error": np.full(ALIGNED_FRAMES, 0.002, np.float32),
    }
    settings = {"aligner": "sgd", "lr": 1e-4, "momentum": 0.9, "steps": 40, "smpl": None}
    put(root / "align", fitted, ALIGNED, config=settings)
    latents = rng.normal(size=(FRAMES, 100)).astype(np.float32)
    put(root / "encode", {"latents": latents[:ALIGNED_FRAMES]}, ALIGNED, config={})
    of_all = {"predictors": PREDICTORS, "default": "dsnet_small", "config": {}}
    predicted = {f"latents_{name}": latents for name in PREDICTORS}
    put(root / "infer", {**predicted, "theta": found_theta, "betas": found_betas}, ALL, **of_all)
    decoded = {
        "offsets_dsnet_small": truth + offsets_of(rng, FRAMES, 1.5e-3),
        "offsets_dsnet_other": 0.2 * truth,
        "offsets_autoencoder": np.concatenate(
            [0.97 * aligned, np.zeros_like(truth[ALIGNED_FRAMES:])]
        ),
    }
    put(root / "decode", decoded, ALL, **of_all)
    _forge_train_ae(root)
    _forge_train(root, rng)
    return root


def _forge_corpus(root: Path) -> None:
    writer = ArtifactWriter(root / "corpus", "corpus", data="synthetic")
    load_body_model("embedded:female").save_smpl_npz(writer.file_path("SMPL_FEMALE.npz"))
    np.savez(writer.file_path("mosh/99001_kicking_poses.npz"), mocap_framerate=100.0)
    writer.finish(config={"seed": 0})


def _forge_train_ae(root: Path) -> None:
    writer = ArtifactWriter(root / "train-ae", "train-ae", data="synthetic")
    writer.put("loss", np.geomspace(1.0, 0.1, 4).astype(np.float32), "1")
    writer.put("validation_loss", np.geomspace(1.1, 0.2, 5).astype(np.float32), "1")
    writer.put("validation_steps", np.arange(0, 50, 10), "step")
    names = [f"model.encoder.linear_{i}.weight" for i in (1, 2)]
    names += [f"model.encoder.conv_{i}.weight" for i in (1, 2, 3, 4)]
    arrays = {name: np.zeros(1, np.float32) for name in (*names, "model.to_latent.weight")}
    save_weights(writer.file_path("autoencoder.safetensors"), arrays)
    writer.record(
        architecture={"widths": [6890, 2000, 1300, 300, 30], "activation": "leaky_relu"},
        autoencoder={
            "preset": "measured",
            "normalisation": "standard",
            "activation": "leaky_relu",
            "learning_rate": 1e-4,
            "departures": ["offsets are divided by one standard deviation"],
            "split": "frame",
            "train_frames": 15,
            "validation_frames": 7,
            "best_step": 40,
            "steps_taken": 40,
            "r2_initial": 0.5,
            "r2_validation": 0.9,
        },
        pca={"components": 100, "r2_validation": 0.95},
        parameters={"mesh_autoencoder": 33_626_606, "casas_otaduy": 284_678_770},
        comparisons=[],
    )
    writer.finish(config={"seed": 0, "batch_size": 64})


def _forge_train(root: Path, rng: np.random.Generator) -> None:
    writer = ArtifactWriter(root / "train", "train", data="synthetic")
    shapes = {
        "fc_enc_1/kernel": (79, 64),
        "fc_enc_2/kernel": (64, 128),
        "lstm/recurrent_kernel": (60, 240),
        "fc_enc_3/kernel": (60, 100),
    }
    arrays = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    for name, scale in zip(PREDICTORS, (300.0, 9000.0), strict=True):
        save_weights(writer.file_path(f"{name}.safetensors"), arrays)
        loss = scale * np.geomspace(1, 0.1, 40) * rng.uniform(0.9, 1.1, 40)
        writer.put(f"loss_{name}", loss.astype(np.float32), "1")
        writer.put(f"validation_loss_{name}", loss[9::10].astype(np.float32) * 1.5, "1")
        writer.put(f"validation_epochs_{name}", np.arange(10, 41, 10, dtype=np.int32), "epoch")
    writer.record(
        parameters={"dsnet": 65_140, "dsnet_trainable": 65_020},
        default="dsnet_small",
        predictors={
            name: {"label": label, "lr": lr, "preset": name, "departures": departures}
            for (name, label), lr, departures in zip(
                PREDICTORS.items(), (1e-3, 1e-4), (["a wrong turn"], []), strict=True
            )
        },
    )
    writer.record_measured(**{f"epoch_s_{name}": 0.1 for name in PREDICTORS})
    settings = {"seed": 0, "epochs": 40, "frames": 300, "batch_size": 16}
    writer.finish(
        config={"default": "dsnet_small", "predictors": dict.fromkeys(PREDICTORS, settings)}
    )


@pytest.fixture(scope="session")
def forged_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder `runs/`, with a run `forged` that lacks `evaluate` and `report`."""
    runs = tmp_path_factory.mktemp("runs")
    forge_run(runs / "forged")
    return runs


@pytest.fixture
def copied(
    forged_runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Run]:
    """Copy that run, without some of its stages, into a folder `runs/` of the test's own."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))

    def copy(name: str, *without: str) -> Run:
        ignored = shutil.ignore_patterns("evaluate", "report", *without)
        shutil.copytree(forged_runs / "forged", tmp_path / "runs" / name, ignore=ignored)
        return Run(name)

    return copy


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report that draws nothing: figures take seconds."""
    monkeypatch.setattr(stage_report, "plan_figures", lambda scene: [])


@pytest.fixture
def forged(forged_runs: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("DSNET_RUNS", str(forged_runs))
    return Run("forged")
