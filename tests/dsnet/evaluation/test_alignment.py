"""Absorption: hand-made estimates, whose figures are known, and the identities that hold always."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.body.model_data import SMPL_JOINT_NAMES
from dsnet.evaluation.alignment import Absorption


def draw_offsets(seed: int, frames: int = 3) -> np.ndarray:
    return 0.01 * np.random.default_rng(seed).normal(size=(frames, 6890, 3))


def measured(body, found, true):
    absorption = Absorption(body)
    absorption.add(found, true)
    return absorption.summary()


def test_the_truth_absorbs_and_invents_nothing(body):
    true = draw_offsets(0)
    whole = measured(body, true, true)["whole"]
    assert (whole["absorbed"], whole["invented_mm"], whole["r2"]) == (0.0, 0.0, 1.0)
    assert whole["true_mm"] == pytest.approx(1e3 * np.sqrt(np.square(true).sum(-1).mean()))


def test_no_offsets_absorb_everything_in_every_part(body):
    true = draw_offsets(0)
    summary = measured(body, np.zeros_like(true), true)
    for figures in (summary["whole"], *summary["parts"].values()):
        if figures["absorbed"] is not None:
            assert figures["absorbed"] == pytest.approx(1.0)
            assert figures["r2"] == pytest.approx(0.0)
            assert figures["invented_mm"] == pytest.approx(0.0, abs=1e-6)
    assert set(summary["parts"]) == set(SMPL_JOINT_NAMES) - {"left_collar", "right_collar"}
    assert sum(part["share"] for part in summary["parts"].values()) == pytest.approx(1.0)


@settings(max_examples=25)
@given(st.floats(-1, 2), st.floats(0, 2), st.integers(0, 99))
def test_absorbed_and_invented_make_up_the_error(body, taken, noise, seed):
    true = draw_offsets(seed)
    found = (1 - taken) * true + noise * draw_offsets(seed + 100)
    whole = measured(body, found, true)["whole"]
    invented = (whole["invented_mm"] / whole["true_mm"]) ** 2
    np.testing.assert_allclose(1 - whole["r2"], whole["absorbed"] ** 2 + invented, atol=1e-9)
    # Independent noise leaves the share that was taken, but for what correlates by chance.
    assert whole["absorbed"] == pytest.approx(taken, abs=0.05 * noise + 1e-9)


def test_an_error_across_the_offsets_is_invented(body):
    true = np.zeros((2, 6890, 3))
    true[..., 0] = 0.003
    found = true.copy()
    found[..., 1] = 0.004
    whole = measured(body, found, true)["whole"]
    assert whole["absorbed"] == pytest.approx(0.0)
    assert whole["invented_mm"] == pytest.approx(4.0)
    assert whole["error_mm"] == pytest.approx(4.0)


def test_parts_that_do_not_move_have_no_share(body):
    head = body.weights.argmax(axis=1) == SMPL_JOINT_NAMES.index("head")
    true = draw_offsets(0)
    true[:, ~head] = 0.0
    found = np.full_like(true, 0.001)
    parts = measured(body, found, true)["parts"]
    assert parts["head"]["share"] == pytest.approx(1.0)
    assert parts["pelvis"]["absorbed"] is None
    assert parts["pelvis"]["invented_mm"] == pytest.approx(np.sqrt(3))


def test_merging_is_adding(body):
    together, first, second = (Absorption(body) for _ in range(3))
    for seed, one in enumerate((first, second)):
        pair = draw_offsets(seed, 2 + seed), draw_offsets(seed + 10, 2 + seed)
        for into in (together, one):
            into.add(*pair)
    first += second
    assert first.summary()["whole"] == pytest.approx(together.summary()["whole"])
    np.testing.assert_allclose(first.sums, together.sums)
