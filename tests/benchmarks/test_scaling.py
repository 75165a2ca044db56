"""The model is plain arithmetic: it gives back what it was drawn from, and says what follows."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scaling.model import needs, predicted_and_measured


def measured(frames: int, workers: int, alone_a_frame: float = 1e-3) -> dict:
    """A stage that behaves exactly as the model: 2 s and `alone_a_frame` alone, tasks of 0.5 s."""
    tasks = frames // 100
    wall_s = 0.5 * np.ceil(tasks / workers)
    phase = {"calls": 1, "tasks": tasks, "wall_s": wall_s, "busy_s": 0.5 * tasks}
    whole_s = 2 + alone_a_frame * frames + wall_s
    own = {"stage": "align", "frames": frames, "workers": workers}
    return {**own, "wall_s": whole_s, "phases": {"fit": phase}}


def test_a_stage_that_is_as_the_model_is_predicted_exactly():
    corpora = [measured(frames, workers) for frames in (200, 500, 900) for workers in (1, 2)]
    rows = predicted_and_measured(corpora)
    assert [(row["frames"], row["workers"]) for row in rows] == [
        (200, 2), (500, 1), (500, 2), (900, 2)
    ]  # fmt: skip
    for row in rows:
        assert row["relative_error"] == pytest.approx(0, abs=1e-9)


def test_needs_of_a_large_corpus():
    (row,) = needs([measured(200, 1), measured(900, 1)], 1e8)
    assert row["core_hours"] == pytest.approx((2 + 1e5 + 5e5) / 3600)
    assert row["alone_hours"] == pytest.approx((2 + 1e5) / 3600)
    assert row["nodes_for_a_day"] is None  # 28 hours in one process
    (row,) = needs([measured(200, 1, 0.0), measured(900, 1, 0.0)], 1e8)
    assert row["nodes_for_a_day"] == 1
