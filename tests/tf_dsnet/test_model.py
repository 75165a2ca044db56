"""The network's sizes, its arithmetic and its weights; the paper's loss; and the fast LSTM against
Keras's own."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from bridge import DsnetError
from dsnet.verify.reference import dsnet as reference
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.model import (
    BlockLSTM,
    assign_weights,
    build_dsnet,
    named_weights,
    parameter_counts,
    sum_of_distances,
)


@pytest.mark.parametrize("masked", [False, True])
def test_parameter_counts_are_the_papers(masked):
    model = build_dsnet(masked=masked)
    assert parameter_counts(model) == {"dsnet": 65_140, "dsnet_trainable": 65_020}


def test_network_computes_what_the_float64_reference_does(weights):
    model = build_dsnet()
    assign_weights(model, weights)
    motion = np.random.default_rng(0).normal(size=(2, 50, 79)).astype(np.float32)
    wide = {name: array.astype(np.float64) for name, array in weights.items()}
    expected = reference.predict(wide, motion.astype(np.float64))["fc_enc_3"]
    np.testing.assert_allclose(model(motion, training=False), expected, rtol=1e-5, atol=2e-5)
    for name, array in named_weights(model).items():
        np.testing.assert_array_equal(array, weights[name])


def test_foreign_weights_are_refused(weights):
    wrong = {**weights, "lstm/bias": np.zeros(120, np.float32)}
    with pytest.raises(DsnetError, match="lstm/bias"):
        assign_weights(build_dsnet(), wrong)
    del wrong["lstm/bias"]
    with pytest.raises(DsnetError, match="lstm/bias"):
        assign_weights(build_dsnet(), wrong)


def test_network_loads_no_torch_whatever_keras_is_told_and_says_nothing():
    code = (
        "import os, sys; os.environ['KERAS_BACKEND'] = 'torch'\n"
        "import tf_dsnet, dsnet.stages.stage_train, dsnet.stages.stage_infer, numpy\n"
        "tf_dsnet.build_dsnet()(numpy.zeros((1, 2, 79), 'f4'))\n"
        "sys.exit('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


RNG = np.random.default_rng(0)
TARGET, PREDICTED = RNG.normal(size=(2, 3, 7, 100))
REAL = np.arange(7) < np.array([7, 4, 1])[:, None]
REAL_FRAMES = tf.constant(REAL)


def gradient(target, predicted, real=None):
    variable = tf.Variable(predicted)
    with tf.GradientTape() as tape:
        loss = sum_of_distances(target, variable, real)
    return np.asarray(tape.gradient(loss, variable))


def test_loss_is_the_sum_over_time_of_unsquared_distances_of_real_frames():
    distances = np.linalg.norm(PREDICTED - TARGET, axis=-1)
    whole = distances.sum(axis=1).mean()
    np.testing.assert_allclose(sum_of_distances(TARGET, PREDICTED), whole, rtol=1e-12)
    expected = (PREDICTED - TARGET) / distances[..., None]
    np.testing.assert_allclose(gradient(TARGET, PREDICTED), expected / 3, rtol=1e-12)
    expected = sum(distances[clip, :length].sum() for clip, length in enumerate((7, 4, 1))) / 3
    np.testing.assert_allclose(
        sum_of_distances(TARGET, PREDICTED, REAL_FRAMES), expected, rtol=1e-12
    )
    assert not gradient(TARGET, PREDICTED, REAL_FRAMES)[~REAL].any()


def test_gradient_is_finite_at_and_near_zero():
    target = np.zeros((1, 3, 100), np.float32)
    predicted = target.copy()
    predicted[0, 1, 0] = 1e-30
    predicted[0, 2, 0] = 1e-6
    found = gradient(target, predicted)
    assert np.isfinite(found).all()
    assert not found[0, 0].any()
    np.testing.assert_allclose(found[0, 2, 0], 1.0, rtol=1e-5)


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
