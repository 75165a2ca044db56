"""The model is plain arithmetic: it gives back what it was drawn from, and says what follows."""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
import pytest

from benchmarks.scaling import observed
from benchmarks.scaling.limits import limits
from benchmarks.scaling.model import (
    Line,
    needs,
    nodes_for,
    predicted_and_measured,
    wall_of_phase,
)
from benchmarks.scaling.overhead import overheads
from bridge.errors import DsnetError
from bridge.runs.untrusted import MOST_JSON_BYTES
from bridge.runs.workers import WorkerPool, worker_pool


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


def test_sizes_that_do_not_differ_are_one_line():
    with pytest.raises(DsnetError, match="two measurements of 200 frames"):
        predicted_and_measured([measured(200, 1), measured(200, 1)])


def test_needs_of_a_large_corpus():
    (row,) = needs([measured(200, 1), measured(900, 1)], 1e8)
    assert row["core_hours"] == pytest.approx((2 + 1e5 + 5e5) / 3600)
    assert row["alone_hours"] == pytest.approx((2 + 1e5) / 3600)
    assert row["nodes_for_a_day"] is None  # 28 hours in one process
    (row,) = needs([measured(200, 1, 0.0), measured(900, 1, 0.0)], 1e8)
    assert row["nodes_for_a_day"] == 1


@pytest.mark.parametrize(
    ("calls", "tasks", "workers", "expected"),
    [(1, 4, 2, 5.0), (1, 5, 2, 6.0), (1, 1, 2, 10.0), (5, 5, 2, 10.0), (1, 0, 2, 0.0)],
)
def test_tasks_go_in_whole_rounds(calls, tasks, workers, expected):
    assert wall_of_phase(10.0, calls, tasks, workers) == pytest.approx(expected)


def test_a_line_is_never_below_zero():
    assert Line.through((1, 5.0), (2, 4.0)) == Line(4.0, 0.0)
    assert Line.through((1, 1.0), (2, 3.0)) == Line(0.0, 2.0)


def test_nodes():
    assert nodes_for(64 * 100.0, 0.0, 100.0) == 1
    assert nodes_for(64 * 100.0, 50.0, 100.0) == 2
    assert nodes_for(1.0, 100.0, 100.0) is None


def test_limits_come_in_their_order():
    rows = limits({"manifest_bytes": 160.0, "digest_mb_s": 400.0}, 321)
    at = [row["sequences"] for row in rows]
    assert at == sorted(at)
    by_name = {row["what"].split(":")[0]: row["sequences"] for row in rows}
    assert by_name["a manifest lists its sequences"] == pytest.approx(MOST_JSON_BYTES / 160)


def test_empty_tasks_are_timed():
    kinds = [one["kind"] for one in overheads(3, with_ray=False)]
    assert kinds == ["serial", "threads", "threads", "processes", "processes"]


def halve(tools: None, item: int) -> float:
    return item / 2


def scale(times: int, tools: None, item: int) -> int:
    return times * item


def with_a_pool(tools: None, item: int) -> list[float]:
    with worker_pool("threads", None, 2) as pool:
        return list(pool.map(halve, range(item)))


def test_phases_are_of_the_inner_pool():
    seen, original = observed.ObservedPools(), WorkerPool.map
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkerPool, "map", lambda *call: seen.map(original, *call))
        with worker_pool("serial", None) as pool:
            assert list(pool.map(with_a_pool, [3, 2])) == [[0.0, 0.5, 1.0], [0.0, 0.5]]
            assert list(pool.map(partial(scale, 3), [1])) == [3]
    assert list(seen.phases) == ["halve", "scale"]
    phase = seen.phases["halve"]
    assert (phase.calls, phase.tasks) == (2, 5)
    assert 0 < phase.longest_s <= phase.busy_s
    if sys.platform == "linux":
        assert phase.read_bytes >= 0 < phase.sent_bytes
