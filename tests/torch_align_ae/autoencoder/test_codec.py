"""The codec on disk: bit-exact round trips; damaged weights are one line."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from torch_align_ae.autoencoder.codec import Codec, read_codec
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.normaliser import Normaliser


@pytest.fixture(scope="module")
def codec():
    torch.manual_seed(0)
    normaliser = Normaliser(torch.randn(60, 3) * 1e-3, torch.rand(60, 3) * 1e-2 + 1e-3)
    return Codec(MeshAutoencoder((60, 40, 30, 20, 12), "elu").eval(), normaliser)


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
    with pytest.raises(DsnetError, match="other arrays") as caught:
        read_codec(path, codec.architecture())
    assert "\n" not in str(caught.value)
