"""The network put together: all of its gradients are right; and Adam."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bridge.exchange.weights import KERAS_ADAM, TORCH_ADAM
from dsnet.verify.reference import dsnet
from dsnet.verify.reference.layers import Arrays

SIZES = {"fc_enc_1": (5, 4), "fc_enc_2": (4, 6), "fc_enc_3": (3, 7)}


REAL = np.arange(6) < np.array([[6], [3], [4]])


@pytest.fixture(scope="module")
def weights() -> Arrays:
    """A narrow DSNet: 5 inputs, 3 LSTM units, 7 latents."""
    rng = np.random.default_rng(8)
    shapes = {f"{name}/kernel": size for name, size in SIZES.items()}
    shapes |= {f"{name}/bias": size[1:] for name, size in SIZES.items()}
    shapes |= {"lstm/kernel": (6, 12), "lstm/recurrent_kernel": (3, 12), "lstm/bias": (12,)}
    drawn = {name: rng.normal(size=shape) for name, shape in shapes.items()}
    norm = {f"batch_norm/{name}": rng.normal(size=3) for name in ("gamma", "beta", "moving_mean")}
    return {**drawn, **norm, "batch_norm/moving_variance": rng.uniform(0.1, 2.0, 3)}


def batch() -> tuple[np.ndarray, np.ndarray]:
    """Motions and latents."""
    rng = np.random.default_rng(9)
    motion, latents = (rng.normal(size=(3, 6, width)) for width in (5, 7))
    return motion * REAL[..., None], latents * REAL[..., None]


@pytest.mark.parametrize("masked", [False, True])
def test_gradients_of_every_parameter(weights, masked):
    clips = (*batch(), REAL if masked else None)
    gradients = dsnet.learn(weights, *clips).gradients
    moving = {"batch_norm/moving_mean", "batch_norm/moving_variance"}
    assert set(gradients) == set(weights) - moving
    rng = np.random.default_rng(0)
    for name, gradient in gradients.items():
        direction = rng.normal(size=gradient.shape)

        def loss(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            return dsnet.learn({**weights, name: weights[name] + step * direction}, *clips).loss

        found = (loss(1e-6) - loss(-1e-6)) / 2e-6
        assert_allclose((gradient * direction).sum(), found, rtol=1e-6, atol=1e-8, err_msg=name)


def test_padding_counts_unless_it_is_masked(weights):
    """Noise in the padding changes the faithful loss and statistics, not the masked ones'."""
    for masked in (False, True):
        clips, real = batch(), REAL if masked else None
        noisy = [array + ~REAL[..., None] for array in clips]
        before, after = (
            dsnet.learn(weights, *clips, real=real),
            dsnet.learn(weights, *noisy, real=real),
        )
        assert (before.loss == after.loss) == masked
        name = "batch_norm/moving_mean"
        assert np.array_equal(before.statistics[name], after.statistics[name]) == masked


def test_running_statistics_move_a_hundredth(weights):
    hidden = dsnet.predict(weights, batch()[0])["lstm"]
    moved = dsnet.learn(weights, *batch()).statistics
    for name, seen in (("mean", hidden.mean((0, 1))), ("variance", hidden.var((0, 1)))):
        before = weights[f"batch_norm/moving_{name}"]
        assert_allclose(moved[f"batch_norm/moving_{name}"], 0.99 * before + 0.01 * seen)


@pytest.mark.parametrize(
    ("rule", "denominator"),
    [(TORCH_ADAM, lambda g: abs(g) + 1e-8), (KERAS_ADAM, lambda g: abs(g) + 1e-7 / 0.001**0.5)],
)
def test_first_step(rule, denominator):
    """m and v are bias-corrected to g and g^2; Keras's epsilon is magnified by the correction."""
    gradient = np.array([1e-9, -1e-6, 3.0])
    zero = {"w": np.zeros(3)}
    weights, first, second = dsnet.adam_step(rule, 1, zero, {"w": gradient}, zero, zero)
    assert_allclose(weights["w"], -1e-4 * gradient / denominator(gradient), rtol=1e-10)
    assert_allclose(first["w"], 0.1 * gradient, rtol=1e-12)
    assert_allclose(second["w"], 0.001 * gradient**2, rtol=1e-10)


def test_training_on_a_bowl():
    """Loss w^2 / 2: names of what is kept, statistics moved once a step, losses before steps."""

    def bowl(weights: dict[str, np.ndarray]) -> dsnet.Pass:
        w = weights["w"]
        return dsnet.Pass(float(w @ w) / 2, {"w": w}, {"count": weights["count"] + 1}, {})

    kept = dsnet.train({"w": np.ones(2), "count": np.zeros(1)}, bowl, TORCH_ADAM, [1, 10])
    assert list(kept) == [
        "loss",
        "grad/w",
        *(
            f"step_{n}/{name}"
            for n in (1, 10)
            for name in ("weight/w", "weight/count", "adam_m/w", "adam_v/w")
        ),
        "losses",
    ]
    assert kept["step_1/weight/count"] == 1
    assert kept["step_10/weight/count"] == 10
    assert len(kept["losses"]) == 10
    assert kept["losses"][0] == kept["loss"] == 1.0
    assert_allclose(kept["step_10/weight/w"], 1 - 10 * 1e-4, atol=1e-6)
    assert "losses" not in dsnet.train(
        {"w": np.ones(2), "count": np.zeros(1)}, bowl, TORCH_ADAM, []
    )
