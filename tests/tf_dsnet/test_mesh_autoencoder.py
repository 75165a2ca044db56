"""The autoencoder's Keras twin against the float64 reference, and its weights in files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange import save_weights
from bridge.verify import draws
from bridge.verify.draws import SMALL_WIDTHS as WIDTHS
from bridge.verify.reference import mesh_autoencoder as reference
from tf_dsnet.framework import keras
from tf_dsnet.mesh_autoencoder import (
    KerasMeshAutoencoder,
    assign_weights,
    named_weights,
    read_codec,
)

ACTIVATIONS = ("leaky_relu", "elu", "tanh", "relu")


def small(activation: str = "leaky_relu") -> KerasMeshAutoencoder:
    network = KerasMeshAutoencoder(WIDTHS, activation, 0.1)
    assign_weights(network.model, draws.autoencoder_weights(0, WIDTHS))
    return network


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(5, WIDTHS[0], 3)).astype(np.float32)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_encoder_and_decoder_are_the_references(values, activation):
    network = small(activation)
    outputs = reference.forward(
        {name: array.astype(np.float64) for name, array in named_weights(network.model).items()},
        values.astype(np.float64),
        {"activation": activation, "negative_slope": 0.1},
    ).outputs
    latents = network.encode(values)
    np.testing.assert_allclose(latents, outputs["to_latent"], atol=2e-5)
    found = network.decode(latents)
    np.testing.assert_allclose(found, outputs["to_coordinates"], atol=2e-5)
    np.testing.assert_array_equal(network.model(values), found)


def test_batch_equals_singles(values):
    network = small()
    singles = np.concatenate([network.encode(values[i : i + 1]) for i in range(len(values))])
    np.testing.assert_allclose(network.encode(values), singles, atol=1e-5)


def test_full_network_has_the_papers_parameters():
    assert KerasMeshAutoencoder().model.count_params() == 33_626_606


def test_weights_have_pytorchs_names_order_and_shapes():
    shapes = {name: array.shape for name, array in named_weights(small().model).items()}
    assert list(shapes)[:6:2] == [
        "encoder.linear_1.weight",
        "encoder.linear_2.weight",
        "encoder.conv_1.weight",
    ]
    assert shapes["encoder.linear_1.weight"] == (4, 3)
    assert shapes["encoder.conv_1.weight"] == (24, 40, 1)
    assert shapes["decoder.conv_4.weight"] == (40, 24, 1)
    assert shapes["to_latent.weight"] == (100, 54)


# Keras 3.15 copies TensorFlow's variables in a way that NumPy 2 has deprecated.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_the_keras_file_gives_every_bit_back(values, tmp_path):
    network = small()
    network.model.save(tmp_path / "autoencoder.keras")
    back: Any = keras.saving.load_model(
        tmp_path / "autoencoder.keras", compile=False, safe_mode=True
    )
    for name, array in named_weights(back).items():
        np.testing.assert_array_equal(array, named_weights(network.model)[name], err_msg=name)
    np.testing.assert_array_equal(back(values), network.model(values))


@pytest.fixture
def codec_file(tmp_path):
    network, rng = small(), np.random.default_rng(2)
    arrays = {f"model.{name}": array for name, array in named_weights(network.model).items()}
    arrays["normaliser.mean_m"] = rng.normal(0, 1e-3, (WIDTHS[0], 3)).astype(np.float32)
    arrays["normaliser.scale_m"] = rng.uniform(1e-3, 1e-2, (WIDTHS[0], 3)).astype(np.float32)
    save_weights(tmp_path / "autoencoder.safetensors", arrays)
    return tmp_path / "autoencoder.safetensors", arrays, network


ARCHITECTURE = {"widths": list(WIDTHS), "activation": "leaky_relu", "negative_slope": 0.1}


def test_the_codec_takes_metres(codec_file, values):
    path, arrays, network = codec_file
    codec = read_codec(path, ARCHITECTURE)
    mean_m, scale_m = arrays["normaliser.mean_m"], arrays["normaliser.scale_m"]
    many = np.tile(values, (30, 1, 1))  # more than one batch
    latents = codec.encode(many * scale_m + mean_m)
    assert latents.shape == (150, 100)
    np.testing.assert_allclose(latents[-5:], network.encode(values), atol=1e-4)
    expected = network.decode(latents).numpy() * scale_m + mean_m
    np.testing.assert_allclose(codec.decode(latents), expected, atol=1e-7)
    assert codec.encode(many[:0]).shape == (0, 100)


def test_what_is_not_the_networks_is_one_line(codec_file, values, tmp_path):
    path, arrays, network = codec_file
    with pytest.raises(DsnetError, match=r"\(5, 39, 3\)"):
        network.encode(values[:, 1:])
    with pytest.raises(DsnetError, match=r"encoder\.conv_4/kernel"):
        read_codec(path, {**ARCHITECTURE, "widths": [40, 24, 24, 12, 7]})
    del arrays["normaliser.scale_m"]
    save_weights(tmp_path / "a.safetensors", arrays)
    with pytest.raises(DsnetError, match="normaliser"):
        read_codec(tmp_path / "a.safetensors", ARCHITECTURE)
