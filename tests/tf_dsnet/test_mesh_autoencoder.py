"""The autoencoder's Keras twin against the float64 reference, and its weights in files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from dsnet.verify import draws
from dsnet.verify.draws import SMALL_WIDTHS as WIDTHS
from dsnet.verify.reference import mesh_autoencoder as reference
from tf_dsnet.framework import keras
from tf_dsnet.mesh_autoencoder import KerasMeshAutoencoder, assign_weights, named_weights


def small() -> KerasMeshAutoencoder:
    network = KerasMeshAutoencoder(WIDTHS)
    assign_weights(network.model, draws.autoencoder_weights(0, WIDTHS))
    return network


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(5, WIDTHS[0], 3)).astype(np.float32)


def test_encoder_and_decoder_are_the_references(values):
    network = small()
    outputs = reference.forward(
        {name: array.astype(np.float64) for name, array in named_weights(network.model).items()},
        values.astype(np.float64),
    ).outputs
    latents = network.encoder(values)
    np.testing.assert_allclose(latents, outputs["to_latent"], atol=2e-5)
    found = network.decoder(latents)
    np.testing.assert_allclose(found, outputs["to_coordinates"], atol=2e-5)
    np.testing.assert_array_equal(network.model(values), found)


def test_full_network_has_the_papers_parameters():
    assert KerasMeshAutoencoder().model.count_params() == 33_626_606


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


def test_what_is_not_the_networks_is_one_line():
    other = draws.autoencoder_weights(0, (40, 24, 24, 12, 7))
    with pytest.raises(DsnetError, match=r"encoder\.conv_4/kernel"):
        assign_weights(small().model, other)
