"""How fast flesh swings in its place, after a model and after the own law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.prediction.strangers import LOOSE, model_hz, ratios, summary
from bridge.body import load_body_model
from tests.forged.plus import soft_flesh

BODY = load_body_model("embedded:female")


@pytest.fixture(scope="module")
def flesh():
    """5 Hz, hanging, nodes for themselves."""
    model = soft_flesh(BODY, 60, frequency_hz=5.0)
    alone = dict.fromkeys(("wave_speed", "bending"), -14.0) | {"normal_ratio": 0.0}
    base = {n: a * 0 + alone[n] if n in alone else a for n, a in model.weights.base.items()}
    return replace(model, weights=replace(model.weights, base=base))


def test_flesh_on_its_own_swings_at_its_frequency(flesh):
    np.testing.assert_allclose(model_hz(flesh, BODY, np.zeros((1, 10))), 5.0, rtol=2e-3)


def test_a_model_twice_as_fast_is_twice_as_stiff_beside_the_law(flesh):
    base = {**flesh.weights.base, "omega": flesh.weights.base["omega"] + np.float32(np.log(2))}
    fast = replace(flesh, weights=replace(flesh.weights, base=base))
    betas = np.random.default_rng(0).normal(size=(1, 10))
    one, other = (ratios(model, BODY, betas) for model in (flesh, fast))
    assert set(one) == set(LOOSE)
    for part in LOOSE:
        assert other[part] / one[part] == pytest.approx(2.0, rel=0.01)


def test_summary_is_of_people_and_of_all_parts_together():
    found = summary({"chest": np.array([1.0, 2.0, 4.0]), "belly": np.array([1.0, 2.0, 4.0])})
    assert found["chest"]["median"] == found["all"]["median"] == 2.0
    assert found["all"]["tenth"] < 2.0 < found["all"]["ninetieth"]
