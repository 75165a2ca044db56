"""Streaming keeps each character's past, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange.dsnet import TrainedDsnet
from dsnet.stream.streaming_predictor import StreamingPredictor

RNG = np.random.default_rng(6)
THETA, BETAS = RNG.normal(1, 1, (3, 60, 69)), RNG.normal(1, 1, (3, 10))


def steps(predictor: StreamingPredictor, theta: np.ndarray, betas: np.ndarray) -> np.ndarray:
    return np.stack([predictor.step(frame, betas) for frame in theta.swapaxes(0, 1)], axis=1)


def test_characters_do_not_influence_each_other(trained):
    together = steps(StreamingPredictor(trained), THETA, BETAS)
    alone = steps(StreamingPredictor(trained), THETA[1:2], BETAS[1:2])
    np.testing.assert_allclose(together[1:2], alone, rtol=1e-5, atol=1e-5)


def test_reset_forgets(trained):
    predictor = StreamingPredictor(trained)
    first = steps(predictor, THETA, BETAS)
    assert np.abs(steps(predictor, THETA, BETAS) - first).max() > 1e-3
    predictor.reset()
    np.testing.assert_array_equal(steps(predictor, THETA, BETAS), first)


def test_returned_latents_and_arguments_are_the_callers_own(trained):
    predictor = StreamingPredictor(trained)
    theta = THETA[:, 0].copy()
    first = predictor.step(theta, BETAS)
    kept = first.copy()
    predictor.step(THETA[:, 1], BETAS)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(theta, THETA[:, 0])


@pytest.mark.parametrize(
    ("theta", "betas"), [((69,), (10,)), ((2, 72), (2, 10)), ((2, 69), (1, 10)), ((2, 69), (2, 16))]
)
def test_other_shapes_are_refused(trained, theta, betas):
    with pytest.raises(DsnetError, match="theta"):
        StreamingPredictor(trained).step(np.zeros(theta), np.zeros(betas))


def test_other_number_of_characters_is_refused_until_reset(trained):
    predictor = StreamingPredictor(trained)
    predictor.step(THETA[:, 0], BETAS)
    with pytest.raises(DsnetError, match="reset"):
        predictor.step(THETA[:2, 0], BETAS[:2])
    predictor.reset()
    assert predictor.step(THETA[:2, 0], BETAS[:2]).shape == (2, 100)


REFUSED = {
    "nan": (5, np.nan),
    "inf": (67, np.inf),
    "minus inf": (0, -np.inf),
    "a root's turn of 1e4 rad": (1, 1e4),
    "a knee's in degrees": (14, 30.0),
    "a kilometre off": (66, 1001.0),
    "beyond float32": (66, 1e300),
}


@pytest.mark.parametrize(("column", "value"), REFUSED.values(), ids=REFUSED)
def test_one_characters_pose_that_is_none_is_refused_and_nothing_has_moved(trained, column, value):
    disturbed, undisturbed = StreamingPredictor(trained), StreamingPredictor(trained)
    broken = THETA[:, 0].copy()
    broken[1, column] = value
    for frame in THETA[:, :9].swapaxes(0, 1):
        with pytest.raises(DsnetError, match="theta with") as no:
            disturbed.step(broken, BETAS)
        assert "\n" not in str(no.value)
        np.testing.assert_array_equal(disturbed.step(frame, BETAS), undisturbed.step(frame, BETAS))


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e4, 1e300])
def test_a_shape_that_is_nobodys_is_refused_and_nothing_has_moved(trained, value):
    predictor, broken = StreamingPredictor(trained), BETAS.copy()
    broken[2, 9] = value
    with pytest.raises(DsnetError, match="betas with"):
        predictor.step(THETA[:, 0], broken)
    found = steps(predictor, THETA, BETAS)
    np.testing.assert_array_equal(found, steps(StreamingPredictor(trained), THETA, BETAS))


@pytest.mark.parametrize(
    "theta", [None, "stand", [["a"] * 69], [[None] * 69], [[1j] * 69], [[1], []]]
)
def test_what_holds_no_numbers_is_refused(trained, theta):
    with pytest.raises(DsnetError, match="theta"):
        StreamingPredictor(trained).step(theta, np.zeros((1, 10)))


@pytest.mark.parametrize("as_type", [str, Path])
def test_a_run_by_its_name(trained_run, trained: TrainedDsnet, as_type):
    by_name = steps(StreamingPredictor(as_type("r")), THETA, BETAS)
    np.testing.assert_array_equal(by_name, steps(StreamingPredictor(trained), THETA, BETAS))
    other = steps(StreamingPredictor(as_type("r"), "dsnet_faithful"), THETA, BETAS)
    assert np.abs(other - by_name).max() > 0.1
