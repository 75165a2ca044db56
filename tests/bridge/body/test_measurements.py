"""A tape that is laid around bodies whose girths are known, and the embedded ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body.model_data import BodyModelData
from dsnet.prediction.shapes import MEASURES, MeasuredBody

MEAN = np.zeros(10)


def measured(body: BodyModelData, betas: np.ndarray = MEAN) -> dict[str, float]:
    return MeasuredBody(body)(betas)


def test_a_persons_measurements(body):
    found = measured(body)
    assert 150 < found["height"] < 190
    assert 45 < found["weight"] < 95
    assert 60 < found["waist"] < found["hips"] < 115
    assert found["waist"] < found["chest"] < 115


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_larger_body_is_larger_by_the_same_factor(female, factor):
    grown = replace(female, v_template=factor * female.v_template)
    ratios = {name: value / measured(female)[name] for name, value in measured(grown).items()}
    expected = {name: factor**3 if name == "weight" else factor for name in MEASURES}
    assert ratios == pytest.approx(expected, rel=1e-9)


def test_girths_of_a_body_whose_sections_are_ellipses(female):
    """The trunk's vertices go to an ellipse about the axis: Ramanujan's perimeter."""
    wide_m, deep_m = 0.2, 0.1
    around = np.arctan2(female.v_template[:, 2] / deep_m, female.v_template[:, 0] / wide_m)
    tube = female.v_template.copy()
    tube[:, 0], tube[:, 2] = wide_m * np.cos(around), deep_m * np.sin(around)
    # Joints stay where they are, as planes lie between them.
    found = measured(replace(female, v_template=tube))
    h = ((wide_m - deep_m) / (wide_m + deep_m)) ** 2
    root = np.sqrt(4 - 3 * h)
    expected_cm = 100 * np.pi * (wide_m + deep_m) * (1 + 3 * h / (10 + root))
    assert found["waist"] == pytest.approx(expected_cm, rel=0.01)
    assert found["hips"] == pytest.approx(expected_cm, rel=0.01)


def test_arms_do_not_count(female):
    """An arm that is moved to the waist changes no girth."""
    arms = female.weights[:, [18, 19, 20, 21, 22, 23]].sum(axis=1) > 0.5
    moved = female.v_template - np.where(arms[:, None], [0.0, 0.25, 0.0], 0.0)
    found, before = measured(replace(female, v_template=moved)), measured(female)
    girths = ("chest", "waist", "hips")
    assert [found[name] for name in girths] == pytest.approx([before[name] for name in girths])


def test_more_betas_than_the_body_has_are_refused(female):
    with pytest.raises(DsnetError, match="betas has shape"):
        MeasuredBody(female)(np.zeros(11))
