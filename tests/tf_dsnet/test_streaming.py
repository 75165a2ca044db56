"""Step by step gives what the whole clip gives."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange.dsnet_presets import Scaling, TrainedDsnet
from tf_dsnet import StreamingPredictor
from tf_dsnet.stage_predict import ClipPredictor

RNG = np.random.default_rng(6)
THETA, BETAS = RNG.normal(1, 1, (3, 60, 69)), RNG.normal(1, 1, (3, 10))


def steps(predictor: StreamingPredictor, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    return np.stack([predictor.step(frame, betas) for frame in theta.swapaxes(0, 1)], axis=1)


@pytest.mark.parametrize("name", ["standardised", "faithful"])
def test_step_by_step_is_the_whole_clip(reading, name):
    if name == "faithful":
        reading = TrainedDsnet(name, reading.weights, Scaling.identity())
    predict = ClipPredictor(reading)
    whole = np.stack([predict(theta, shape) for theta, shape in zip(THETA, BETAS, strict=True)])
    streamed = steps(StreamingPredictor(reading), THETA, BETAS)
    assert streamed.dtype == np.float32
    np.testing.assert_allclose(streamed, whole, rtol=1e-5, atol=2e-5)


def test_characters_do_not_influence_each_other(reading):
    together = steps(StreamingPredictor(reading), THETA, BETAS)
    alone = steps(StreamingPredictor(reading), THETA[1:2], BETAS[1:2])
    np.testing.assert_allclose(together[1:2], alone, rtol=1e-5, atol=1e-5)


def test_reset_forgets(reading):
    predictor = StreamingPredictor(reading)
    first = steps(predictor, THETA, BETAS)
    assert np.abs(steps(predictor, THETA, BETAS) - first).max() > 1e-3
    predictor.reset()
    np.testing.assert_array_equal(steps(predictor, THETA, BETAS), first)


def test_returned_latents_and_arguments_are_the_callers_own(reading):
    predictor = StreamingPredictor(reading)
    theta = THETA[:, 0].copy()
    first = predictor.step(theta, BETAS)
    kept = first.copy()
    predictor.step(THETA[:, 1], BETAS)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(theta, THETA[:, 0])


@pytest.mark.parametrize(
    ("theta", "betas"), [((69,), (10,)), ((2, 72), (2, 10)), ((2, 69), (1, 10)), ((2, 69), (2, 16))]
)
def test_other_shapes_are_refused(reading, theta, betas):
    with pytest.raises(DsnetError, match="theta"):
        StreamingPredictor(reading).step(np.zeros(theta), np.zeros(betas))


def test_other_number_of_characters_is_refused_until_reset(reading):
    predictor = StreamingPredictor(reading)
    predictor.step(THETA[:, 0], BETAS)
    with pytest.raises(DsnetError, match="reset"):
        predictor.step(THETA[:2, 0], BETAS[:2])
    predictor.reset()
    assert predictor.step(THETA[:2, 0], BETAS[:2]).shape == (2, 100)


def test_unknown_run(runs):
    with pytest.raises(DsnetError, match="unknown run 'nope'"):
        StreamingPredictor("nope")
