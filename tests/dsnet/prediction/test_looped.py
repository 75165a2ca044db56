"""Tissue of a motion that repeats: the lap that is given follows on itself, for either pipeline."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from dsnet.prediction.loops import close_loop
from dsnet.prediction.models import (
    FRAMES_AT_ONCE,
    DsnetModel,
    PlusModel,
    Prediction,
    predict_loop,
    predict_whole,
)
from dsnet.verify.reference.oscillators import node_offsets
from tests.forged.cyclic import circling

BODY = load_body_model("embedded:female")
BETAS = np.zeros(10)
LAP = 40


def offsets_of(found: Prediction) -> np.ndarray:
    return np.concatenate(list(found.offsets_m))


def lap_of(theta: np.ndarray):
    return close_loop(theta, BODY.joints[0])


@pytest.mark.parametrize("lap_frames", [LAP, FRAMES_AT_ONCE + 30])
@pytest.mark.parametrize("look_ahead", [0, 1])
def test_it_is_a_late_lap_of_many(flesh, lap_frames, look_ahead):
    """The oracle predicts the motion over and over, in one piece."""
    model = replace(flesh, look_ahead=look_ahead)
    lap = lap_of(circling(lap_frames + 1, lap_frames))
    found = offsets_of(predict_loop(partial(predict_whole, PlusModel(model, BODY)), lap, BETAS))
    count = 1 + 600 // lap_frames
    long = node_offsets(model, BODY, circling((count + 1) * lap_frames, lap_frames), BETAS)
    expected = model.nodes.spread(long[(count - 1) * lap_frames : count * lap_frames])
    assert found.shape == expected.shape
    assert np.abs(expected).max() > 2e-3
    np.testing.assert_allclose(found, expected, atol=1e-4)
    once = offsets_of(predict_whole(PlusModel(model, BODY), lap.theta, BETAS))
    assert np.abs(once - found).max() > 1e-3


def test_the_networks_tissue_repeats_too(trained, trained_run):
    codec = trained_run.artifact("train-ae")
    network = partial(predict_whole, DsnetModel(trained, codec, BODY))
    lap = lap_of(circling(LAP + 1, LAP, turn_rad=1e-9, stride_m=1e-12))
    found = predict_loop(network, lap, BETAS)
    assert found.latents is not None
    long = network(lap.repeated(12), BETAS)
    assert long.latents is not None
    np.testing.assert_allclose(found.latents, long.latents[-LAP:], atol=0.05)
    np.testing.assert_allclose(offsets_of(found), offsets_of(long)[-LAP:], atol=1e-4)


class Counting:
    """Offsets that are the time, and how many frames of them were asked for."""

    def __init__(self, settles_after: float) -> None:
        self.given, self.settles_after = 0, settles_after

    def __call__(self, theta, betas):
        def pieces():
            for start in range(0, len(theta), 7):
                part = np.arange(start, min(start + 7, len(theta)))
                self.given += len(part)
                values = np.exp(-part / self.settles_after)
                yield np.repeat(values[:, None, None], 3, axis=2).astype(np.float32)

        return Prediction(pieces(), np.arange(len(theta), dtype=np.float32)[:, None])


def test_only_as_many_laps_as_it_takes():
    predict = Counting(settles_after=20.0)
    lap = lap_of(circling(LAP, LAP))
    found = predict_loop(predict, lap, BETAS)
    asked = predict.given
    offsets_m = offsets_of(found)
    assert len(offsets_m) == LAP
    assert predict.given - asked == pytest.approx(LAP, abs=7)
    assert found.latents is not None
    first = int(found.latents[0, 0])
    assert first % LAP == 0
    np.testing.assert_allclose(offsets_m[:, 0, 0], np.exp(-found.latents[:, 0] / 20.0), rtol=1e-5)
    # sqrt(3) e^(-t / 20) m, and with it what is left of it, is 0.1 mm at frame 195: the lap that
    # begins at 200 is the first that the next one agrees with, and that one was skipped.
    assert first == 7 * LAP


def test_what_never_settles_is_refused():
    lap = lap_of(circling(LAP, LAP))
    with pytest.raises(DsnetError, match=r"--loop with offsets that still differ by \d+\.\d mm"):
        predict_loop(Counting(settles_after=1e4), lap, BETAS)
