"""The fast LSTM against Keras's own, which is its oracle: outputs, states and gradients."""

from __future__ import annotations

import numpy as np
import pytest

from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.lstm import BlockLSTM
from tf_dsnet.model import assign_weights, build_dsnet


def pair(size: int = 5, **options) -> tuple[keras.layers.LSTM, keras.layers.LSTM]:
    """Keras's layer and ours with the same random weights, biases included."""
    layers = keras.layers.LSTM(7, **options), BlockLSTM(7, **options)
    rng = np.random.default_rng(0)
    for layer in layers:
        layer.build((None, None, size))
    weights = [rng.normal(size=array.shape) for array in layers[0].get_weights()]
    for layer in layers:
        layer.set_weights(weights)
    return layers


def sequences(batch: int, frames: int, size: int = 5) -> Tensor:
    rng = np.random.default_rng(1)
    return tf.constant(rng.normal(size=(batch, frames, size)), keras.config.floatx())


def operations(layer: keras.layers.LSTM, x: Tensor) -> set[str]:
    graph = tf.function(lambda x: layer(x, training=True)).get_concrete_function(x).graph
    return {operation.type for operation in graph.get_operations()}


@pytest.mark.parametrize("shape", [(1, 1), (3, 2), (16, 40)])
def test_outputs_states_and_gradients_are_keras(shape):
    x = sequences(*shape)
    pull = sequences(*shape, size=7)
    results = []
    for layer in pair(return_sequences=True, return_state=True):
        with tf.GradientTape() as tape:
            tape.watch(x)
            outputs, hidden, memory = layer(x)
            score = tf.reduce_sum(outputs * pull) + tf.reduce_sum(hidden) + tf.reduce_sum(memory)
        gradients = tape.gradient(score, [x, *layer.trainable_variables])
        results.append([outputs, hidden, memory, *gradients])
    for expected, got in zip(*results, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-5)


def test_it_goes_on_from_a_state():
    x, state = sequences(2, 6), [sequences(2, 7, 1)[..., 0], sequences(2, 7, 1)[..., 0] + 1]
    expected, got = (layer(x, initial_state=state) for layer in pair())
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)


@pytest.mark.skipif(
    bool(tf.config.list_physical_devices("GPU")),
    reason="on a GPU Keras's own layer runs, which has cuDNN",
)
def test_a_cpu_runs_one_operation():
    assert "BlockLSTM" in operations(BlockLSTM(7), sequences(2, 6))


@pytest.mark.parametrize(
    "options",
    [
        {"activation": "relu"},
        {"recurrent_activation": "hard_sigmoid"},
        {"use_bias": False},
        {"go_backwards": True},
        {"dropout": 0.5},
        {"recurrent_dropout": 0.5},
        {"dtype": "float64"},
    ],
)
def test_what_the_operation_cannot_do_is_left_to_keras(options):
    keras_layer, layer = pair(**options)
    x = sequences(2, 6)
    assert "BlockLSTM" not in operations(layer, x)
    np.testing.assert_allclose(layer(x), keras_layer(x), rtol=1e-5, atol=1e-6)


def test_a_mask_is_left_to_keras():
    x, real = sequences(2, 6), tf.constant([[True] * 6, [True] * 3 + [False] * 3])
    expected, got = (layer(x, mask=real) for layer in pair())
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)


def test_dsnet_is_the_same_with_either(weights):
    motion = np.random.default_rng(0).normal(size=(3, 50, 79)).astype(np.float32)
    latents = []
    for layer in (keras.layers.LSTM, BlockLSTM):
        model = build_dsnet(lstm_layer=layer)
        assign_weights(model, weights)
        latents.append(model(motion, training=False))
    np.testing.assert_allclose(latents[1], latents[0], rtol=1e-5, atol=1e-4)
