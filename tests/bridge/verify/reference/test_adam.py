"""Adam by hand: the first step of either form, and what training leaves behind."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bridge.exchange.weights import KERAS_ADAM, TORCH_ADAM
from bridge.verify.reference.adam import Pass, adam_step, train


@pytest.mark.parametrize(
    ("rule", "denominator"),
    [(TORCH_ADAM, lambda g: abs(g) + 1e-8), (KERAS_ADAM, lambda g: abs(g) + 1e-7 / 0.001**0.5)],
)
def test_first_step(rule, denominator):
    """m and v are bias-corrected to g and g^2; Keras's epsilon is magnified by the correction."""
    gradient = np.array([1e-9, -1e-6, 3.0])
    zero = {"w": np.zeros(3)}
    weights, first, second = adam_step(rule, 1, zero, {"w": gradient}, zero, zero)
    assert_allclose(weights["w"], -1e-4 * gradient / denominator(gradient), rtol=1e-10)
    assert_allclose(first["w"], 0.1 * gradient, rtol=1e-12)
    assert_allclose(second["w"], 0.001 * gradient**2, rtol=1e-10)


def test_training_on_a_bowl():
    """Loss w^2 / 2: names of what is kept, statistics moved once a step, losses before steps."""

    def bowl(weights: dict[str, np.ndarray]) -> Pass:
        w = weights["w"]
        return Pass(float(w @ w) / 2, {"w": w}, {"count": weights["count"] + 1})

    kept = train({"w": np.ones(2), "count": np.zeros(1)}, bowl, TORCH_ADAM, [1, 10])
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
    assert "losses" not in train({"w": np.ones(2), "count": np.zeros(1)}, bowl, TORCH_ADAM, [])
