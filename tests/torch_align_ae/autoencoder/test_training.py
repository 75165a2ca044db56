"""Training: it learns, keeps the best epoch, and resumes with the same bits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch

from bridge.motion.splits import split_frames
from bridge.paper import INFERRED_WIDTHS
from torch_align_ae.autoencoder.codec import Codec
from torch_align_ae.autoencoder.initialisation import initialise_with_modes
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.normaliser import fit_normaliser
from torch_align_ae.autoencoder.scoring import reconstruction_r2
from torch_align_ae.autoencoder.training import Training, TrainingPlan

SMALL = (60, 40, 30, 20, 12)


def smooth_offsets(frames: int, vertices: int, seed: int = 0) -> np.ndarray:
    """A few waves along the vertex index that swing in time: what tissue looks like, roughly."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(frames)[:, None] / 60
    place = np.linspace(0, 1, vertices)
    swing = np.sin(2 * np.pi * rng.uniform(1, 4, (1, 9)) * time_s + rng.uniform(0, 6, (1, 9)))
    waves = np.sin(np.pi * np.outer(np.arange(1, 4), place))
    return 5e-3 * np.einsum("tkc,kv->tvc", swing.reshape(frames, 3, 3), waves).astype(np.float32)


def training(folder, plan: TrainingPlan, offsets_m: np.ndarray | None = None, widths=SMALL):
    offsets_m = smooth_offsets(200, widths[0]) if offsets_m is None else offsets_m
    split = split_frames(len(offsets_m), seed=0)
    torch.manual_seed(0)
    normaliser = fit_normaliser("standard", offsets_m, split.train)
    model = MeshAutoencoder(widths)
    return Training(model, normaliser, offsets_m, split, plan, folder / "a.safetensors")


def weights(job: Training) -> dict[str, np.ndarray]:
    return {name: value.numpy().copy() for name, value in job.model.state_dict().items()}


def test_pytorchs_beginning_learns_in_a_few_hundred_steps(tmp_path):
    job = training(tmp_path, TrainingPlan(steps=300, batch_size=16, learning_rate=3e-3))
    result = job.run()
    codec = Codec(job.model.eval(), job.normaliser)
    assert result.history[-1, 1] < 0.8 * result.history[0, 1]
    assert reconstruction_r2(codec, job.offsets_m, job.split.validation) > 0.2


def test_a_few_steps_at_full_size_learn_a_swing_that_the_modes_have_not_seen(tmp_path):
    place = np.linspace(0, np.pi, 6890)[:, None] * [1, 2, 3]
    seen_m, unseen_m = (
        5e-3 * np.sin(np.arange(40) * rate)[:, None, None] * np.sin(waves * place)
        for waves, rate in ((1, 0.5), (2, 0.8))
    )
    plan = TrainingPlan(steps=12, batch_size=8, learning_rate=3e-4)
    job = training(tmp_path, plan, (seen_m + unseen_m).astype(np.float32), INFERRED_WIDTHS)
    sample = torch.from_numpy(seen_m[:20].astype(np.float32)) / job.normaliser.scale_m
    initialise_with_modes(job.model, sample, seed=0)
    result = job.run()
    codec = Codec(job.model.eval(), job.normaliser)
    assert result.history[-1, 1] < 0.9 * result.history[0, 1]
    assert reconstruction_r2(codec, job.offsets_m, job.split.validation) > 0.5


class _KilledError(Exception):
    pass


@pytest.mark.parametrize("killed_after", [1, 3])
def test_a_killed_training_resumes_with_the_same_bits(tmp_path, monkeypatch, killed_after):
    plan = TrainingPlan(
        steps=12, batch_size=64, learning_rate=1e-3, warmup_steps=3, cosine_decay=True
    )
    whole = training(tmp_path / "whole", plan)
    (tmp_path / "whole").mkdir()
    (tmp_path / "killed").mkdir()
    expected = whole.run()

    killed = training(tmp_path / "killed", plan)
    epoch = killed._epoch

    def dies(number, steps, bar):
        if number > killed_after:
            raise _KilledError
        return epoch(number, steps, bar)

    monkeypatch.setattr(killed, "_epoch", dies)
    with pytest.raises(_KilledError):
        killed.run()
    resumed = training(tmp_path / "killed", plan)
    found = resumed.run()
    np.testing.assert_array_equal(found.history, expected.history)
    for name, value in weights(whole).items():
        np.testing.assert_array_equal(weights(resumed)[name], value, err_msg=name)


def test_the_best_epoch_is_kept(tmp_path, monkeypatch):
    job = training(tmp_path, TrainingPlan(steps=12, batch_size=64, learning_rate=1e-3))
    losses, seen = iter([5.0, 3.0, 1.0, 2.0, 4.0]), []

    def scripted() -> float:
        seen.append(weights(job))
        return next(losses)

    monkeypatch.setattr(job, "validation_loss", scripted)
    result = job.run()
    assert result.best_epoch == 2
    assert len(seen) == 5
    for name, value in weights(job).items():
        np.testing.assert_array_equal(value, seen[2][name])
    assert any((seen[4][name] != seen[2][name]).any() for name in seen[2])


def test_patience_stops(tmp_path, monkeypatch):
    plan = TrainingPlan(steps=100, batch_size=140, patience=2)
    job = training(tmp_path, plan)
    losses = iter([5.0, 3.0, 4.0, 4.0, 0.0])
    monkeypatch.setattr(job, "validation_loss", lambda: next(losses))
    assert len(job.run().history) == 4


def test_an_epoch_shows_every_training_frame_once(tmp_path):
    job = training(tmp_path, TrainingPlan(steps=3, batch_size=64))
    seen = torch.cat(list(job._batches(1))).numpy()
    other = torch.cat(list(job._batches(2))).numpy()
    expected = job.offsets_m[job.split.train]
    assert seen.shape == expected.shape
    assert not np.array_equal(seen, other)

    def key(frames):
        return np.sort(frames[:, 7, 1])

    np.testing.assert_array_equal(key(seen), key(expected))
    np.testing.assert_array_equal(key(other), key(expected))


def test_learning_rate_warms_up_and_decays():
    plan = TrainingPlan(steps=100, learning_rate=1.0, warmup_steps=10, cosine_decay=True)
    rates = [plan.learning_rate_at(step) for step in range(100)]
    np.testing.assert_allclose(rates[:11], [*np.arange(1, 11) / 10, 1.0])
    assert all(later <= earlier for earlier, later in pairwise(rates[10:]))
    assert rates[-1] < 1e-3
    assert TrainingPlan(steps=5, learning_rate=1e-4).learning_rate_at(4) == 1e-4
