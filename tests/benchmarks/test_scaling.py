"""The model is plain arithmetic: it gives back what it was drawn from, and says what follows."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scaling.model import predicted_and_measured


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
