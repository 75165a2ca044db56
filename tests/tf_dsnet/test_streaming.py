"""Step by step gives what Keras gives for the whole clip."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.exchange.dsnet import Scaling, TrainedDsnet
from tf_dsnet import StreamingPredictor
from tf_dsnet.predictors.dsnet import DsnetOfMotions

RNG = np.random.default_rng(6)
THETA, BETAS = RNG.normal(1, 1, (3, 60, 69)), RNG.normal(1, 1, (3, 10))


def steps(predictor: StreamingPredictor, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    return np.stack([predictor.step(frame, betas) for frame in theta.swapaxes(0, 1)], axis=1)


@pytest.mark.parametrize("scaled", [True, False])
def test_step_by_step_is_the_whole_clip(trained_dsnet, scaled):
    if not scaled:
        trained_dsnet = TrainedDsnet("raw", trained_dsnet.weights, Scaling.identity())
    predict = DsnetOfMotions(trained_dsnet)
    whole = np.stack([predict(theta, shape) for theta, shape in zip(THETA, BETAS, strict=True)])
    streamed = steps(StreamingPredictor(trained_dsnet), THETA, BETAS)
    assert streamed.dtype == np.float32
    np.testing.assert_allclose(streamed, whole, rtol=1e-5, atol=2e-5)
