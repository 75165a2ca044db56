"""Codes: bit-exact files, damaged ones in one line; what is normalised by what; streamed PCA."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from torch_align_ae.autoencoder.codes import (
    Codec,
    Normaliser,
    PcaCodec,
    fit_normaliser,
    read_codec,
    reconstruction_r2,
)
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder


@pytest.fixture(scope="module")
def codec():
    torch.manual_seed(0)
    normaliser = Normaliser(torch.randn(60, 3) * 1e-3, torch.rand(60, 3) * 1e-2 + 1e-3)
    return Codec(MeshAutoencoder((60, 40, 30, 20, 12)).eval(), normaliser)


@pytest.fixture(scope="module")
def offsets_m():
    return np.random.default_rng(0).standard_normal((130, 60, 3)).astype(np.float32) * 1e-2


def test_round_trip_is_bit_exact(codec, offsets_m, tmp_path):
    codec.save(tmp_path / "a.safetensors")
    back = read_codec(tmp_path / "a.safetensors", codec.architecture())
    latents = codec.encode(offsets_m)
    np.testing.assert_array_equal(back.encode(offsets_m), latents)
    np.testing.assert_array_equal(back.decode(latents), codec.decode(latents))


def test_shapes_units_and_batches(codec, offsets_m):
    latents = codec.encode(offsets_m)
    assert latents.shape == (130, 100)
    assert codec.decode(latents).shape == (130, 60, 3)
    np.testing.assert_allclose(codec.encode(offsets_m[65:67]), latents[65:67], atol=1e-5)
    with torch.inference_mode():
        values = (torch.from_numpy(offsets_m) - codec.normaliser.mean_m) / codec.normaliser.scale_m
        np.testing.assert_allclose(codec.model.encode(values), latents, atol=1e-4)


def test_no_frames_give_no_latents(codec, offsets_m):
    assert codec.encode(offsets_m[:0]).shape == (0, 100)
    assert codec.decode(np.zeros((0, 100), np.float32)).shape == (0, 60, 3)


def test_truncated_weights_are_one_line(codec, tmp_path):
    path = tmp_path / "a.safetensors"
    codec.save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DsnetError, match=r"a\.safetensors"):
        read_codec(path, codec.architecture())


@pytest.mark.parametrize("damage", ["missing", "reshaped", "foreign"])
def test_weights_of_another_network_are_one_line(codec, tmp_path, damage):
    path = tmp_path / "a.safetensors"
    codec.save(path)
    arrays = load_weights(path)
    if damage == "missing":
        del arrays["model.to_latent.bias"]
    elif damage == "reshaped":
        arrays["model.to_latent.bias"] = np.zeros(99, np.float32)
    else:
        arrays["surprise"] = np.zeros(3, np.float32)
    save_weights(path, arrays)
    with pytest.raises(DsnetError, match="differ from the network's in") as caught:
        read_codec(path, codec.architecture())
    assert "\n" not in str(caught.value)


READINGS = ("global_maximum", "coordinate_range", "standard")


@pytest.fixture(scope="module")
def spread_m():
    rng = np.random.default_rng(0)
    scale = np.geomspace(1e-3, 3e-2, 40)[:, None]
    return (rng.standard_normal((300, 40, 3)) * scale + 5e-3).astype(np.float32)


@pytest.mark.parametrize("name", READINGS)
def test_denormalise_inverts_normalise(spread_m, name):
    normaliser = fit_normaliser(name, spread_m, np.arange(200))
    values = torch.from_numpy(spread_m)
    np.testing.assert_allclose(
        normaliser.denormalise(normaliser.normalise(values)), values, atol=1e-8
    )


def test_standard_values_have_mean_zero_and_deviation_one(spread_m):
    values = fit_normaliser("standard", spread_m, np.arange(300)).normalise(
        torch.from_numpy(spread_m)
    )
    np.testing.assert_allclose(values.mean(dim=0), 0, atol=1e-5)
    np.testing.assert_allclose(values.square().mean().sqrt(), 1, rtol=1e-5)


@pytest.mark.parametrize("name", READINGS)
def test_other_frames_do_not_enter(spread_m, name):
    changed = spread_m.copy()
    changed[200:] = 9.0
    first, second = (fit_normaliser(name, x, np.arange(200)) for x in (spread_m, changed))
    np.testing.assert_array_equal(first.mean_m, second.mean_m)
    np.testing.assert_array_equal(first.scale_m, second.scale_m)


@pytest.mark.parametrize("name", READINGS)
def test_still_vertices_stay_finite(name):
    normaliser = fit_normaliser(name, np.zeros((4, 5, 3), np.float32), np.arange(4))
    assert torch.isfinite(normaliser.normalise(torch.zeros(1, 5, 3))).all()


def _offsets(rng: np.random.Generator) -> np.ndarray:
    spectrum = 1e-2 * 0.8 ** np.arange(60)
    left, right = rng.standard_normal((400, 60)), rng.standard_normal((60, 240))
    return ((left * spectrum) @ right + 2e-3).reshape(400, 80, 3).astype(np.float32)


def test_components_span_the_leading_singular_vectors_of_the_training_frames():
    rng = np.random.default_rng(0)
    offsets_m, frames = _offsets(rng), rng.permutation(400)[:300]
    codec = PcaCodec.fit(offsets_m, frames, size=10)
    flat = offsets_m[np.sort(frames)].reshape(300, -1).astype(np.float64)
    right = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][:10]
    np.testing.assert_allclose(codec.components @ codec.components.T, np.eye(10), atol=1e-5)
    np.testing.assert_allclose(np.abs(np.diag(codec.components @ right.T)), 1, atol=1e-4)


def test_all_components_reconstruct_and_fewer_lose():
    rng = np.random.default_rng(1)
    offsets_m, frames = _offsets(rng), np.arange(400)
    scores = [
        reconstruction_r2(PcaCodec.fit(offsets_m, frames, size), offsets_m, frames)
        for size in (2, 10, 60)
    ]
    assert scores[0] < scores[1] < scores[2]
    np.testing.assert_allclose(scores[2], 1, atol=1e-6)


def test_given_directions_are_kept_in_their_order():
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((80, 3, 4)) @ rng.standard_normal((4, 4))
    codec = PcaCodec.of_directions(directions)
    assert codec.latent_size == 4
    np.testing.assert_allclose(codec.components @ codec.components.T, np.eye(4), atol=1e-6)
    first = directions[..., 0].ravel() / np.linalg.norm(directions[..., 0])
    np.testing.assert_allclose(codec.components[0], first, atol=1e-6)
    offsets_m = (1e-3 * directions @ rng.standard_normal((4, 9))).transpose(2, 0, 1)
    kept = codec.decode(codec.encode(offsets_m.astype(np.float32)))
    np.testing.assert_allclose(kept, offsets_m, atol=1e-8)
