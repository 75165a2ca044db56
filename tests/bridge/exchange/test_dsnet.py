"""What DSNet is given, and which of a run's predictors are DSNet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.dsnet import (
    Scaling,
    UnpaddedClip,
    dsnets_of,
    fit_scaling,
    load_trained_dsnet,
    load_unpadded_clips,
    make_clips,
)
from bridge.runs import Artifact, ArtifactWriter, read_artifact
from tests.forged.encoded import write_encoded


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40))
def test_sequences_are_padded_or_clipped(length, wanted):
    recordings = random_recordings((length, 7))
    clips = make_clips(recordings, Scaling.identity(), wanted)
    for name in ("inputs", "latents"):
        block, frames = getattr(clips, name)[0], getattr(recordings[0], name).astype(np.float32)
        assert block.shape == (wanted, frames.shape[1])
        np.testing.assert_array_equal(block[:length], frames[:wanted])
        assert not block[length:].any()
    assert clips.real[0].sum() == min(length, wanted)


def random_recordings(lengths: tuple[int, ...] = (5, 12)) -> list[UnpaddedClip]:
    rng = np.random.default_rng(1)
    return [
        UnpaddedClip(rng.normal(3, 2, (n, 79)), rng.normal(-1, rng.uniform(0, 4, 100), (n, 100)))
        for n in lengths
    ]


def test_scaling_is_of_the_real_frames_and_goes_back():
    recordings = random_recordings()
    scaling = fit_scaling(recordings, min_input_std=0.0)
    inputs, latents = (
        np.concatenate([getattr(r, name) for r in recordings]) for name in ("inputs", "latents")
    )
    np.testing.assert_allclose(scaling.inputs(inputs).mean(axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(scaling.inputs(inputs).std(axis=0), 1, rtol=1e-5)
    np.testing.assert_allclose(scaling.latents(latents).mean(axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(scaling.latents(latents).var(axis=0).mean(), 1, rtol=1e-5)
    np.testing.assert_allclose(scaling.restore(scaling.latents(latents)), latents, atol=1e-5)


def test_still_inputs_and_dead_latents_are_not_magnified():
    noise = np.random.default_rng(2).normal(scale=1e-6, size=(50, 79))
    latents = np.zeros((50, 100))
    latents[:, 0] = np.linspace(-10, 10, 50)
    latents[:, 1] = 1e-6 * np.cos(np.arange(50))
    scaling = Scaling.fitted(noise, latents, min_input_std=0.05)
    assert np.abs(scaling.inputs(noise)).max() < 1e-3
    assert np.abs(scaling.latents(latents)[:, 1]).max() < 1e-5


def test_clips_are_zero_and_marked_where_padded_whatever_the_scaling():
    recordings = random_recordings()
    clips = make_clips(recordings, fit_scaling(recordings, 0.05), 8)
    assert clips.inputs.shape == (2, 8, 79)
    assert clips.inputs.dtype == clips.latents.dtype == np.float32
    np.testing.assert_array_equal(clips.real.sum(axis=1), [5, 8])
    assert not clips.inputs[~clips.real].any()
    assert not clips.latents[~clips.real].any()
    plain = make_clips(recordings, Scaling.identity(), 8)
    np.testing.assert_array_equal(plain.inputs[0, :5], recordings[0].inputs.astype(np.float32))


def test_splits_are_the_indexs(tmp_path):
    write_encoded(tmp_path / "encode")
    encoded = read_artifact(tmp_path / "encode")
    assert [len(r.inputs) for r in load_unpadded_clips(encoded, "validation")] == [30]
    assert [len(r.inputs) for r in load_unpadded_clips(encoded, "train")] == [25, 40, 35, 20, 45]
    last = load_unpadded_clips(encoded, "train")[-1]
    np.testing.assert_array_equal(last.inputs[0, :10], encoded.array("betas")[1])
    np.testing.assert_array_equal(last.inputs[:, 10:], encoded.array("theta")[-45:])
    with pytest.raises(DsnetError, match="split 'test'"):
        load_unpadded_clips(encoded, "test")


def trained(tmp_path, **arrays) -> Artifact:
    writer = ArtifactWriter(tmp_path / "train", "train", data="synthetic")
    for name, weights in arrays.items():
        save_weights(writer.file_path(f"{name}.safetensors"), weights)
    writer.record(default=next(iter(arrays)), predictors={name: {} for name in arrays})
    return writer.finish()


def test_another_system_is_not_dsnet(tmp_path):
    weights = {"fc_enc_1/kernel": np.zeros((79, 64), np.float32)}
    made = trained(tmp_path, dsnet_like=weights, dsnet_faithful=weights)
    assert dsnets_of(made) == ["dsnet_faithful"]
    assert load_trained_dsnet(made, "dsnet_faithful").scaling.input_mean.shape == (79,)
    with pytest.raises(DsnetError, match=r"'dsnet_like', which is not DSNet.*; .*dsnet_faithful"):
        load_trained_dsnet(made)


@pytest.mark.parametrize("kernel", [{}, {"fc_enc_1/kernel": np.zeros((148, 64), np.float32)}])
def test_weights_of_other_inputs_are_refused(tmp_path, kernel):
    made = trained(tmp_path, dsnet_faithful={"other": np.zeros(1, np.float32), **kernel})
    with pytest.raises(DsnetError, match=r"of a network of \d+ inputs; expected 79"):
        load_trained_dsnet(made)
