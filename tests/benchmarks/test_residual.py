"""The residual autoencoder: PCA before the first step, more than PCA afterwards."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.subspaces.residual import ResidualAutoencoder, initialise_with_pca
from bridge.motion.splits import split_frames
from torch_align_ae.autoencoder.codes import PcaCodec, fit_normaliser
from torch_align_ae.autoencoder.training import Training, TrainingPlan

VERTICES, WIDTH, SIZE = 50, 8, 4
FRAMES = np.arange(400)


def curved_offsets() -> np.ndarray:
    """Waves whose harmonics follow from them: flat to PCA, foreseeable to a curved code."""
    angles = np.random.default_rng(0).uniform(-2, 2, (len(FRAMES), SIZE))
    place = np.linspace(0, np.pi, VERTICES * 3)
    waves = np.stack([np.sin((k + 1) * place) for k in range(WIDTH)])
    swings = np.concatenate([angles, 0.4 * (angles**2 - 4 / 3)], axis=1)
    return 3e-3 * (swings @ waves).reshape(-1, VERTICES, 3).astype(np.float32)


def started(normalisation) -> tuple[ResidualAutoencoder, PcaCodec, np.ndarray]:
    offsets_m = curved_offsets()
    pca = PcaCodec.fit(offsets_m, FRAMES, WIDTH)
    torch.manual_seed(0)
    model = ResidualAutoencoder(VERTICES, SIZE, WIDTH)
    initialise_with_pca(model, pca, fit_normaliser(normalisation, offsets_m, FRAMES))
    return model, pca, offsets_m


@pytest.mark.parametrize("normalisation", ["standard", "global_maximum"])
def test_it_begins_as_pca_of_the_latents_size(normalisation):
    model, pca, offsets_m = started(normalisation)
    normaliser = fit_normaliser(normalisation, offsets_m, FRAMES)
    less = PcaCodec(pca.mean_m, pca.components[:SIZE])
    coefficients_m = less.encode(offsets_m)
    with torch.inference_mode():
        values = normaliser.normalise(torch.from_numpy(offsets_m))
        latents = model.encode(values)
        rebuilt_m = normaliser.denormalise(model(values))
    unit_m = float(normaliser.scale_m.mean())
    np.testing.assert_allclose(latents * unit_m, coefficients_m, atol=1e-7)
    np.testing.assert_allclose(rebuilt_m, less.decode(coefficients_m), atol=1e-7)


def test_its_beginning_is_pca_to_the_last_digit():
    model, pca, offsets_m = started("standard")
    normaliser = fit_normaliser("standard", offsets_m, FRAMES)
    double = PcaCodec(pca.mean_m, np.float64(pca.components))  # type: ignore[arg-type]
    model = model.double()
    for layer, weight in (
        (model.from_offsets, double.components),
        (model.to_offsets, double.components.T),
    ):
        np.testing.assert_array_equal(layer.weight.detach(), weight)
    centred = (offsets_m - np.float64(pca.mean_m)).reshape(len(offsets_m), -1)
    expected = centred @ double.components[:SIZE].T @ double.components[:SIZE]
    scale_m = normaliser.scale_m.double()
    with torch.inference_mode():
        values = (torch.from_numpy(offsets_m).double() - normaliser.mean_m) / scale_m
        rebuilt_m = model(values) * scale_m + normaliser.mean_m
    found = (rebuilt_m.numpy() - pca.mean_m).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_training_bends_the_code_beyond_pca(tmp_path):
    model, _pca, offsets_m = started("standard")
    split = split_frames(FRAMES, seed=0)
    plan = TrainingPlan(steps=150, learning_rate=3e-3, warmup_steps=20, cosine_decay=True)
    normaliser = fit_normaliser("standard", offsets_m, FRAMES)
    job = Training(model, normaliser, offsets_m, split, plan, tmp_path / "a.safetensors")
    result = job.run()
    assert result.validation_losses.min() < 0.5 * result.validation_losses[0]


def test_every_weight_learns():
    model, _pca, _offsets_m = started("standard")
    values = torch.randn(64, VERTICES, 3)
    adam = torch.optim.Adam(model.parameters(), 1e-3)
    for _ in range(3):
        adam.zero_grad()
        (model(values) - values).square().mean().backward()
        adam.step()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None
        assert (parameter.grad != 0).all(), name


def test_sizes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="9 latents of 8"):
        ResidualAutoencoder(VERTICES, 9, 8)
    _model, pca, offsets_m = started("standard")
    normaliser = fit_normaliser("standard", offsets_m, FRAMES)
    with pytest.raises(ValueError, match="components"):
        initialise_with_pca(ResidualAutoencoder(VERTICES, SIZE, WIDTH + 1), pca, normaliser)
