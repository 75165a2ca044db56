"""Dyna-like on a law of its own kind, rolled on its own past."""

from __future__ import annotations

import numpy as np

from benchmarks.systems import dyna_like
from bridge.exchange.train_options import PredictorSettings
from bridge.paper import N_BETAS
from tests.forged.driven import forged_data


def test_a_motion_that_was_left_out_is_rolled_to_its_latents(body, tmp_path, monkeypatch):
    """Far from what one-step errors promise: many frames on predictions alone."""
    monkeypatch.setattr(dyna_like, "RIDGES", dyna_like.RIDGES[:1])
    data, entry = forged_data(body, clips=18, frames=150), dyna_like.DynaLike()
    training = entry.training(PredictorSettings(epochs=1), data, tmp_path / "c.safetensors")
    training.epoch(0, validate=True)
    predict = entry.load(training.arrays(), lambda: body)
    (clip,) = data.validation
    found = predict(clip.inputs[:, N_BETAS:], clip.betas)
    assert (found.shape, found.dtype) == (clip.latents.shape, np.float32)
    missed = np.square(found - clip.latents).sum() / np.square(clip.latents).sum()
    assert missed < 0.01
