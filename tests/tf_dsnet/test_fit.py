"""`Trainer` and a `compile` and `fit` of one's own give the bits of a loop written by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.exchange.dsnet import Clips
from tests.pages import python_blocks
from tf_dsnet import BlockLSTM, ClipBatches, SumOfDistances, build_dsnet
from tf_dsnet.clip_batches import batches_of_epoch
from tf_dsnet.framework import be_reproducible, keras, tf
from tf_dsnet.model import assign_weights, named_weights, sum_of_distances
from tf_dsnet.trainer import Trainer

EPOCHS = 4


@pytest.fixture(scope="module")
def clips() -> Clips:
    rng = np.random.default_rng(0)
    motion, latents = (rng.standard_normal((9, 40, d)).astype(np.float32) for d in (79, 100))
    return Clips(motion, latents, np.ones((9, 40), bool))


@pytest.fixture(scope="module")
def trained(clips):
    """Weights at the start, after epochs of a loop written by hand, and their losses."""
    be_reproducible(3)
    network, adam = build_dsnet(), keras.optimizers.Adam(1e-3)
    adam.build(network.trainable_variables)
    start = named_weights(network)

    @tf.function(input_signature=[tf.TensorSpec((None, 40, size)) for size in (79, 100)])
    def step(motion, latents):
        with tf.GradientTape() as tape:
            loss = sum_of_distances(latents, network(motion, training=True))
        gradients = tape.gradient(loss, network.trainable_variables)
        adam.apply(gradients, network.trainable_variables)
        return loss

    losses = []
    for epoch in range(EPOCHS):
        batches = batches_of_epoch(len(clips), 4, 3, epoch)
        each = [float(step(clips.inputs[rows], clips.latents[rows])) for rows in batches]
        losses.append(np.average(each, weights=[*map(len, batches)]))
    return start, named_weights(network), losses


def test_the_trainer_gives_the_bits_of_the_loop(clips, trained):
    start, weights, losses = trained
    trainer = Trainer(clips, lr=1e-3, batch_size=4, seed=3, build=build_dsnet)
    assert_same(trainer.model, start)
    trainer.trace()
    assert_same(trainer.model, start)
    np.testing.assert_allclose([trainer.epoch(n) for n in range(EPOCHS)], losses, rtol=1e-6)
    assert_same(trainer.model, weights)


def fitted(clips: Clips, start: dict, *callbacks: keras.callbacks.Callback) -> keras.Model:
    be_reproducible(3)
    network: Any = build_dsnet()
    assign_weights(network, start)
    network.compile(keras.optimizers.Adam(1e-3), SumOfDistances(), jit_compile=False)
    data = ClipBatches(clips, batch_size=4, seed=3)
    every = [data.in_order(), *callbacks]
    network.fit(data, epochs=EPOCHS, shuffle=False, verbose=0, callbacks=every)
    return network


def assert_same(network: keras.Model, weights: dict) -> None:
    for name, array in named_weights(network).items():
        np.testing.assert_array_equal(array, weights[name], err_msg=name)


def test_fit_gives_the_bits_of_the_loop(clips, trained):
    start, weights, losses = trained
    network = fitted(clips, start)
    assert_same(network, weights)
    np.testing.assert_allclose(network.history.history["loss"], losses, rtol=1e-6)


def test_epochs_differ_without_the_callback_too(clips):
    data = ClipBatches(clips, batch_size=4)
    epochs = []
    for _ in range(3):
        epochs.append(np.concatenate([data[row][0] for row in range(len(data))]))
        data.on_epoch_end()
    for one in epochs:
        np.testing.assert_array_equal(np.sort(one[:, 0, 0]), np.sort(clips.inputs[:, 0, 0]))
    assert len({one.tobytes() for one in epochs}) == 3


def test_a_fit_that_was_interrupted_goes_on_to_the_same_bits(clips, trained, tmp_path):
    start, weights, _ = trained

    class Killed(keras.callbacks.Callback):
        def on_epoch_begin(self, epoch, logs=None):
            if epoch == 2:
                raise KeyboardInterrupt

    def backup() -> keras.callbacks.Callback:
        return keras.callbacks.BackupAndRestore(str(tmp_path / "backup"))

    with pytest.raises(KeyboardInterrupt):
        fitted(clips, start, backup(), Killed())
    assert_same(fitted(clips, start, backup()), weights)


def test_the_fast_layer_and_the_loss_are_saved_and_opened(clips, tmp_path):
    network = build_dsnet(lstm_layer=BlockLSTM)
    network.compile("adam", SumOfDistances())
    network.optimizer.build(network.trainable_variables)
    network.save(tmp_path / "fast.keras")
    opened: Any = keras.models.load_model(tmp_path / "fast.keras")
    assert isinstance(opened.get_layer("lstm"), BlockLSTM)
    assert isinstance(opened.loss, SumOfDistances)
    np.testing.assert_array_equal(opened(clips.inputs), network(clips.inputs))


def test_the_pages_lines_train_a_run(encoded_run, tmp_path, monkeypatch):
    (block,) = [one for one in python_blocks("docs/deployment.md") if "compile" in one]
    monkeypatch.chdir(tmp_path)
    lines = block.replace('"demo"', f'"{encoded_run.name}"').replace("epochs=500", "epochs=2")
    exec(lines, {})
    assert len(Path("loss.csv").read_text().splitlines()) == 3
    opened: Any = keras.models.load_model("dsnet.keras", compile=False)
    assert opened.count_params() == 65_140
