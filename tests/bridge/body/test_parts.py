"""Parts share every vertex among them, are where their names say, and fade into each other."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body.parts import GROUPS, PARTS, part_weights


def test_every_vertex_is_shared_among_parts(body, small_body):
    for model in (body, small_body):
        weights = part_weights(model)
        assert weights.shape == (model.vertex_count, len(PARTS))
        assert weights.min() >= 0
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)


def centre(body, part: str) -> np.ndarray:
    weights = part_weights(body)[:, PARTS.index(part)]
    assert weights.max() > 0.99

    return np.average(body.v_template, axis=0, weights=weights)


def test_parts_lie_above_and_before_each_other(body):
    height = {part: centre(body, part)[1] for part in PARTS}
    depth = {part: centre(body, part)[2] for part in PARTS}
    for upper, lower in (
        ("head", "chest"),
        ("chest", "belly"),
        ("back", "buttocks"),
        ("belly", "thighs"),
        ("buttocks", "thighs"),
        ("thighs", "calves"),
        ("calves", "feet"),
    ):
        assert height[upper] > height[lower] + 0.1
    assert depth["chest"] > depth["back"] + 0.05
    assert depth["belly"] > depth["buttocks"] + 0.05


def test_parts_are_the_same_left_and_right(body):
    share = part_weights(body)
    left = body.v_template[:, 0] > 0.02
    right = body.v_template[:, 0] < -0.02
    np.testing.assert_allclose(share[left].sum(axis=0), share[right].sum(axis=0), rtol=0.02)


def test_parts_fade_into_each_other(body):
    edges = np.concatenate([body.faces[:, [0, 1]], body.faces[:, [1, 2]]])
    share = part_weights(body)
    steps = np.abs(share[edges[:, 0]] - share[edges[:, 1]]).sum(axis=1)
    # From one part to another is a step of 2.
    assert np.percentile(steps, 99.9) < 1.0


@pytest.mark.parametrize("group", GROUPS)
def test_groups_are_of_parts(group):
    assert group not in PARTS
    assert set(GROUPS[group]) <= set(PARTS)
