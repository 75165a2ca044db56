"""One training run is reproducible, learns, and treats padding as it is told."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.errors import DsnetError
from bridge.exchange.dsnet import Clips, fit_scaling, load_unpadded_clips, make_clips
from bridge.runs import read_artifact
from tf_dsnet.trainer import Trainer


@pytest.fixture
def clips(encoded_run) -> Clips:
    recordings = load_unpadded_clips(read_artifact(encoded_run / "encode"), "train")
    return make_clips(recordings, fit_scaling(recordings, 0.05), 50)


def assert_same_state(one: Trainer, other: Trainer) -> None:
    states = one.state(), other.state()
    assert states[0].keys() == states[1].keys()
    for name, array in states[0].items():
        np.testing.assert_array_equal(array, states[1][name], err_msg=name)


def test_restored_trainer_goes_on_bit_identically(clips):
    whole = Trainer(clips, lr=1e-3, batch_size=2, seed=5)
    losses = [whole.epoch(number) for number in range(4)]

    first = Trainer(clips, lr=1e-3, batch_size=2, seed=5)
    assert [first.epoch(number) for number in range(2)] == losses[:2]
    second = Trainer(clips, lr=1e-3, batch_size=2, seed=99)
    second._seed = 5
    second.restore(first.state())
    assert [second.epoch(number) for number in range(2, 4)] == losses[2:]
    assert_same_state(whole, second)
    assert int(second.state()["adam/0"]) == 12


@pytest.mark.parametrize("of", ["fc_enc_1/kernel", "adam/2"])
def test_another_networks_state_is_refused_in_one_line(clips, of):
    trainer = Trainer(clips, lr=1e-3)
    state = trainer.state()
    wrong = [state | {of: state[of].T}, state | {f"{of}_2": state[of]}]
    for given in (*wrong, {name: array for name, array in state.items() if name != of}):
        with pytest.raises(DsnetError, match=of) as caught:
            trainer.restore(given)
        assert "\n" not in str(caught.value)


def test_seed_decides(clips):
    one, other = (Trainer(clips, lr=1e-3, seed=seed).epoch(0) for seed in (0, 1))
    assert one != other


def test_loss_falls_below_that_of_the_mean(clips):
    trainer = Trainer(clips, lr=3e-3, batch_size=2)
    for number in range(80):
        last = trainer.epoch(number)
    of_the_mean = np.linalg.norm(clips.latents, axis=-1).sum(axis=1).mean()
    assert last < 0.7 * of_the_mean
    assert trainer.loss(clips) < 0.7 * of_the_mean


def test_a_clips_loss_is_its_own_whatever_came_before(clips):
    trainer = Trainer(clips, lr=0.0, batch_size=2)
    other = Clips(clips.inputs, clips.latents + np.float32(3), clips.real)
    trainer.epoch(0)
    trainer.loss(clips)
    predicted = np.asarray(trainer.model(other.inputs, training=False))
    distances = np.linalg.norm(predicted - other.latents, axis=-1).sum(axis=1)
    assert trainer.loss(other) == pytest.approx(distances.mean(), rel=1e-6)


def with_garbage_where_padded(clips: Clips) -> Clips:
    garbage = np.random.default_rng(8).normal(size=clips.inputs.shape).astype(np.float32)
    return Clips(
        np.where(clips.real[..., None], clips.inputs, garbage),
        np.where(clips.real[..., None], clips.latents, np.float32(7)),
        clips.real,
    )


def test_padding_matters_only_without_the_mask(clips):
    def statistics(data: Clips, masked: bool):
        trainer = Trainer(data, lr=1e-3, batch_size=5, masked=masked)
        loss = trainer.epoch(0)
        state = trainer.state()
        return loss, state["batch_norm/moving_variance"], state["fc_enc_2/kernel"]

    other = with_garbage_where_padded(clips)
    for clean, dirty in zip(statistics(clips, True), statistics(other, True), strict=True):
        np.testing.assert_allclose(dirty, clean, rtol=1e-5, atol=1e-6)
    loss, variance, _ = statistics(clips, False)
    dirty_loss, dirty_variance, _ = statistics(other, False)
    assert dirty_loss > 1.5 * loss
    assert np.abs(dirty_variance - variance).max() > 1e-5


def test_masked_statistics_are_those_of_the_real_frames(clips):
    trainer = Trainer(clips, lr=0.0, batch_size=5, masked=True)
    layers = trainer.model.layers
    memory = clips.inputs
    for layer in layers[: [layer.name for layer in layers].index("lstm") + 1]:
        memory = layer(memory) if layer.weights else memory
    expected = np.asarray(memory)[clips.real].mean(axis=0)
    trainer.epoch(0)
    np.testing.assert_allclose(
        trainer.state()["batch_norm/moving_mean"], 0.01 * expected, rtol=1e-4, atol=1e-6
    )
