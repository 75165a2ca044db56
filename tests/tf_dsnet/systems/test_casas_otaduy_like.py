"""A network of two past frames: it learns from given ones and predicts from its own."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.systems.casas_otaduy_like import (
    CasasOtaduyLike,
    TwoFrameNetwork,
)
from bridge.exchange.train_options import PredictorSettings
from tf_dsnet.framework import be_reproducible
from tf_dsnet.model import assign_weights, named_weights

SETTINGS = PredictorSettings(epochs=12, frames=64, batch_size=4)
ENTRY = CasasOtaduyLike()
RNG = np.random.default_rng(3)


@pytest.fixture
def network() -> TwoFrameNetwork:
    """With weights that matter everywhere, and no noise."""
    be_reproducible(1)
    made = TwoFrameNetwork("two_frames")
    biases = {name: array for name, array in named_weights(made).items() if "bias" in name}
    drawn = {name: RNG.normal(scale=0.1, size=array.shape) for name, array in biases.items()}
    assign_weights(made, {**named_weights(made), **drawn})
    return made


def one_frame(weights: dict[str, NDArray], inputs: NDArray) -> NDArray:
    """The network's step from (..., 338) in NumPy."""
    for layer in ("fc_1", "fc_2"):
        inputs = np.maximum(inputs @ weights[f"{layer}/kernel"] + weights[f"{layer}/bias"], 0.0)
    return inputs @ weights["fc_3/kernel"] + weights["fc_3/bias"]


def test_predictions_feed_on_themselves_from_zero(network):
    motion = RNG.normal(size=(2, 7, 138)).astype(np.float32)
    weights = named_weights(network)
    one, two = np.zeros((2, 100)), np.zeros((2, 100))
    expected = []
    for frame in range(7):
        now = one_frame(weights, np.concatenate([motion[:, frame], one, two], axis=1))
        expected.append(now)
        one, two = now, one
    found = network(motion, training=False).numpy()
    np.testing.assert_allclose(found, np.stack(expected, axis=1), rtol=1e-4, atol=1e-5)


def test_predictions_know_no_targets_and_no_padding(network):
    inputs = RNG.normal(size=(2, 7, 338)).astype(np.float32)
    other = inputs.copy()
    other[..., 138:] += 5.0
    real = np.ones((2, 7), bool)
    found = network(inputs, training=False).numpy()
    np.testing.assert_array_equal(network([other, real], training=False).numpy(), found)
    assert np.abs(network(other, training=True) - network(inputs, training=True)).max() > 0.1
