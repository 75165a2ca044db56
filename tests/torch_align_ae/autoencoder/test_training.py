"""Training: it learns, keeps the best epoch, and resumes with the same bits."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest
import torch

from bridge import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.weights import save_checkpoint
from bridge.motion.splits import split_frames
from torch_align_ae.autoencoder.codes import Codec, fit_normaliser, reconstruction_r2
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
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


def training(
    folder, plan: TrainingPlan, offsets_m: np.ndarray | None = None, widths=SMALL, where="cpu"
):
    offsets_m = smooth_offsets(200, widths[0]) if offsets_m is None else offsets_m
    split = split_frames(np.arange(len(offsets_m)), seed=0)
    torch.manual_seed(0)
    normaliser = fit_normaliser("standard", offsets_m, split.train)
    model = MeshAutoencoder(widths).to(where)
    return Training(model, normaliser, offsets_m, split, plan, folder / "a.safetensors")


def weights(job: Training) -> dict[str, np.ndarray]:
    return {name: value.cpu().numpy().copy() for name, value in job.model.state_dict().items()}


def test_pytorchs_beginning_learns_in_a_few_hundred_steps(tmp_path, where):
    plan = TrainingPlan(steps=300, batch_size=16, learning_rate=3e-3)
    job = training(tmp_path, plan, where=where)
    result = job.run()
    codec = Codec(job.model.eval(), job.normaliser)
    assert result.validation_losses[-1] < 0.8 * result.validation_losses[0]
    assert reconstruction_r2(codec, job.offsets_m, job.split.validation) > 0.2


class _KilledError(Exception):
    pass


@pytest.mark.parametrize("bfloat16", [False, True])
@pytest.mark.parametrize(("every", "killed_after"), [(0, 3), (0, 9), (2, 4), (5, 5)])
def test_a_killed_training_resumes_with_the_same_bits(
    tmp_path, monkeypatch, every, killed_after, bfloat16, where
):
    plan = TrainingPlan(
        bfloat16=bfloat16,
        steps=12,
        batch_size=64,
        learning_rate=1e-3,
        warmup_steps=3,
        cosine_decay=True,
        validate_every=every,
    )
    whole = training(tmp_path / "whole", plan, where=where)
    (tmp_path / "whole").mkdir()
    (tmp_path / "killed").mkdir()
    expected = whole.run()

    killed = training(tmp_path / "killed", plan, where=where)
    train = killed._train

    def dies(steps, bar):
        if steps.start >= killed_after:
            raise _KilledError
        return train(steps, bar)

    monkeypatch.setattr(killed, "_train", dies)
    with pytest.raises(_KilledError):
        killed.run()
    resumed = training(tmp_path / "killed", plan, where=where)
    found = resumed.run()
    for name, array in vars(expected).items():
        np.testing.assert_array_equal(vars(found)[name], array, err_msg=name)
    for name, value in weights(whole).items():
        np.testing.assert_array_equal(weights(resumed)[name], value, err_msg=name)


@pytest.mark.parametrize("kept", [0, 1, 3])
def test_a_kill_between_best_weights_and_checkpoint_changes_nothing(tmp_path, monkeypatch, kept):
    plan = TrainingPlan(steps=8, batch_size=64, learning_rate=1e-3, validate_every=2)
    expected = training(tmp_path / "whole", plan)
    (tmp_path / "whole").mkdir()
    (tmp_path / "killed").mkdir()
    expected.run()
    save, calls = Training._save, []

    def dies(*arguments) -> None:
        calls.append(arguments)
        if len(calls) > kept:
            raise _KilledError
        save(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Training, "_save", dies)
        with pytest.raises(_KilledError):
            training(tmp_path / "killed", plan).run()
    resumed = training(tmp_path / "killed", plan)
    resumed.run()
    assert len(resumed.step_s) == plan.steps - 2 * kept
    for name, value in weights(expected).items():
        np.testing.assert_array_equal(weights(resumed)[name], value, err_msg=name)


def test_the_least_validation_loss_is_kept(tmp_path, monkeypatch):
    job = training(tmp_path, TrainingPlan(steps=12, batch_size=64, learning_rate=1e-3))
    losses, seen = iter([5.0, 3.0, 1.0, 2.0, 4.0]), []

    def scripted() -> float:
        seen.append(weights(job))
        return next(losses)

    monkeypatch.setattr(job, "validation_loss", scripted)
    result = job.run()
    assert result.best == 2
    assert len(seen) == 5
    for name, value in weights(job).items():
        np.testing.assert_array_equal(value, seen[2][name])
    assert any((seen[4][name] != seen[2][name]).any() for name in seen[2])


def test_patience_stops(tmp_path, monkeypatch):
    plan = TrainingPlan(steps=100, batch_size=140, patience=2)
    job = training(tmp_path, plan)
    losses = iter([5.0, 3.0, 4.0, 4.0, 0.0])
    monkeypatch.setattr(job, "validation_loss", lambda: next(losses))
    assert len(job.run().validation_losses) == 4


def test_steps_of_bfloat16_products_go_where_those_of_float32_go(tmp_path):
    """A bfloat16 has 8 digits: products of them, added in float32, are right to half a percent."""
    plan = TrainingPlan(steps=6, batch_size=64, learning_rate=1e-3)
    exact, rounded = (training(tmp_path, replace(plan, bfloat16=b)) for b in (False, True))
    slopes = []
    for job in (exact, rounded):
        batch = next(iter(job._batches(0)))
        with torch.autocast("cpu", torch.bfloat16, enabled=job.plan.bfloat16):
            loss = job._loss(batch)
        by_weight = torch.autograd.grad(loss, list(job.model.parameters()))
        slopes.append(torch.cat([slope.flatten() for slope in by_weight]))
    assert not torch.equal(*slopes)
    assert slopes[1].dtype == torch.float32
    assert (slopes[1] - slopes[0]).norm() < 0.02 * slopes[0].norm()
    rounded.checkpoint = tmp_path / "rounded.safetensors"
    losses = [job.run().validation_losses for job in (exact, rounded)]
    np.testing.assert_allclose(losses[1], losses[0], rtol=5e-3)
    assert losses[1][0] == losses[0][0]  # validation is float32
    assert {value.dtype for value in weights(rounded).values()} == {np.dtype(np.float32)}


@pytest.mark.parametrize("steps", [2, 5])
def test_how_often_is_validated_changes_no_weight(tmp_path, steps):
    once = training(tmp_path, TrainingPlan(steps=7, batch_size=64, learning_rate=1e-3))
    once.run()
    again = training(
        tmp_path, TrainingPlan(steps=7, batch_size=64, learning_rate=1e-3, validate_every=steps)
    )
    again.checkpoint = tmp_path / "again.safetensors"
    result = again.run()
    np.testing.assert_array_equal(result.steps, [*range(0, 7, steps), 7])
    last = [load_weights(job.checkpoint) for job in (once, again)]
    for name in (n for n in last[0] if n.startswith("model.")):
        np.testing.assert_array_equal(last[1][name], last[0][name], err_msg=name)


def test_kept_weights_that_lack_one_are_refused(tmp_path):
    job = training(tmp_path, TrainingPlan(steps=3, batch_size=64))
    job.run()
    kept = load_weights(job.best_file)
    del kept["to_latent.bias"]
    save_checkpoint(job.best_file, kept)
    with pytest.raises(DsnetError, match=r"a\.best\.safetensors without to_latent\.bias"):
        job.run()


@pytest.mark.parametrize("losses", [[5.0, math.nan], [5.0, math.inf], [math.nan]])
def test_a_loss_that_is_not_finite_is_one_line(tmp_path, monkeypatch, losses):
    job = training(tmp_path, TrainingPlan(steps=6, batch_size=64))
    given = iter(losses)
    monkeypatch.setattr(job, "validation_loss", lambda: next(given))
    with pytest.raises(DsnetError, match=r"autoencoder with a validation loss of .* after step"):
        job.run()


def test_an_epoch_shows_every_training_frame_once(tmp_path):
    job = training(tmp_path, TrainingPlan(steps=3, batch_size=64))
    seen, other = (torch.cat(list(islice(job._batches(k), 3))).numpy() for k in (0, 3))
    expected = job.offsets_m[job.split.train]
    assert seen.shape == expected.shape
    assert not np.array_equal(seen, other)

    def key(frames):
        return np.sort(frames[:, 7, 1])

    np.testing.assert_array_equal(key(seen), key(expected))
    np.testing.assert_array_equal(key(other), key(expected))


def test_the_first_validation_loss_is_computed_reproducibly(tmp_path, monkeypatch):
    torch.use_deterministic_algorithms(False)
    job, seen = training(tmp_path, TrainingPlan(steps=1, batch_size=64)), []

    def noted() -> float:
        seen.append(torch.are_deterministic_algorithms_enabled())
        return 1.0

    monkeypatch.setattr(job, "validation_loss", noted)
    job.run()
    assert seen == [True, True]


def test_learning_rate_warms_up_and_decays():
    plan = TrainingPlan(steps=100, warmup_steps=10, cosine_decay=True)
    rates = [plan.rate_factor(step) for step in range(100)]
    np.testing.assert_allclose(rates[:11], [*np.arange(1, 11) / 10, 1.0])
    assert all(later <= earlier for earlier, later in pairwise(rates[10:]))
    assert rates[-1] < 1e-3
    assert TrainingPlan(steps=5).rate_factor(4) == 1


def test_learning_rate_can_follow_the_initial_error(tmp_path):
    plan = TrainingPlan(steps=2, batch_size=64, learning_rate_of_loss=1e-3)
    job = training(tmp_path, plan)
    initial = job.validation_loss()
    job.run()
    assert job.learning_rate == pytest.approx(1e-3 * initial)
    assert job._adam.param_groups[0]["lr"] == job.learning_rate
