"""The network put together: all of its gradients are right; and what training keeps.

What a step of Adam gives, and statistics: `tests/dsnet/verify/test_agreement.py`.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bridge.exchange.weights import TORCH_ADAM
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


def test_training_on_a_bowl():
    """Loss w^2 / 2: names of what is kept, statistics moved once a step, losses before steps."""
    start = {"w": np.ones(2), "count": np.zeros(1)}

    def bowl(weights: dict[str, np.ndarray]) -> dsnet.Pass:
        w = weights["w"]
        return dsnet.Pass(float(w @ w) / 2, {"w": w}, {"count": weights["count"] + 1}, {})

    kept = dsnet.train(start, bowl, TORCH_ADAM, [1, 10])
    of_step = ("weight/w", "weight/count", "adam_m/w", "adam_v/w")
    steps = [f"step_{n}/{name}" for n in (1, 10) for name in of_step]
    assert list(kept) == ["loss", "grad/w", *steps, "losses"]
    assert kept["step_1/weight/count"] == 1
    assert kept["step_10/weight/count"] == 10
    assert len(kept["losses"]) == 10
    assert kept["losses"][0] == kept["loss"] == 1.0
    assert_allclose(kept["step_10/weight/w"], 1 - 10 * 1e-4, atol=1e-6)
    assert "losses" not in dsnet.train(start, bowl, TORCH_ADAM, [])
