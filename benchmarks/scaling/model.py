"""Plain arithmetic: how long a stage takes with other workers, of another size; what it needs.

A stage does some things alone, in one process, and some in phases of independent tasks. Both grow
linearly with frames: two sizes measured with one worker give the lines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge.errors import DsnetError

CORES_A_NODE = 64
DAY_S = 86_400.0


@dataclass(frozen=True)
class Line:
    """`at_none + a_frame * frames`, neither below 0."""

    at_none: float
    a_frame: float

    @classmethod
    def through(cls, small: tuple[float, float], large: tuple[float, float]) -> Line:
        """Through two points (frames, value), the first of fewer frames.

        Raises
        ------
        DsnetError
            If both are of the same frames.
        """
        if small[0] == large[0]:
            raise DsnetError(
                f"two measurements of {small[0]:,} frames",
                "a line through two sizes",
                "Measure corpora that differ in it.",
            )
        a_frame = max(0.0, (large[1] - small[1]) / (large[0] - small[0]))
        return cls(max(0.0, large[1] - a_frame * large[0]), a_frame)

    def __call__(self, frames: float) -> float:
        """The value at so many frames."""
        return self.at_none + self.a_frame * frames


@dataclass(frozen=True)
class StageModel:
    """Of one stage."""

    alone: Line
    """Seconds of one process."""
    busy: Mapping[str, Line]
    """Seconds of all tasks of a phase together."""

    @classmethod
    def of(cls, small: Mapping[str, Any], large: Mapping[str, Any]) -> StageModel:
        """From two measurements with one worker, the first of fewer frames."""
        ends = [(one["frames"], alone_s(one)) for one in (small, large)]
        busy = {
            name: Line.through(*((one["frames"], busy_s(one, name)) for one in (small, large)))
            for name in large["phases"]
        }
        return cls(Line.through(*ends), busy)

    def wall_s(self, frames: float, workers: int, tasks: Mapping[str, tuple[int, int]]) -> float:
        """Seconds with some workers; `tasks` has of each phase its calls and tasks."""
        phases = (
            wall_of_phase(line(frames), *tasks.get(name, (1, 0)), workers)
            for name, line in self.busy.items()
        )
        return self.alone(frames) + sum(phases)


def alone_s(measured: Mapping[str, Any]) -> float:
    """Seconds of a measured stage outside its phases."""
    return measured["wall_s"] - sum(phase["wall_s"] for phase in measured["phases"].values())


def busy_s(measured: Mapping[str, Any], name: str) -> float:
    """Seconds of a phase with one worker, with what the pool itself takes."""
    return measured["phases"][name]["wall_s"] if name in measured["phases"] else 0.0


def wall_of_phase(busy: float, calls: int, tasks: int, workers: int) -> float:
    """Seconds of tasks of equal length in so many calls, one after the other: whole rounds."""
    if not tasks:
        return 0.0
    a_call = tasks / calls
    return busy * math.ceil(a_call / workers) / a_call


def predicted_and_measured(measured: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Every measurement that the lines were not drawn through, beside what the model says.

    The lines of a stage go through its smallest and largest corpus with one worker.
    """
    rows = []
    for stage in dict.fromkeys(one["stage"] for one in measured):
        own = sorted((one for one in measured if one["stage"] == stage), key=lambda m: m["frames"])
        small, *_, large = (one for one in own if one["workers"] == 1)
        model = StageModel.of(small, large)
        for one in own:
            if one is small or one is large:
                continue
            tasks = {name: (p["calls"], p["tasks"]) for name, p in one["phases"].items()}
            said = model.wall_s(one["frames"], one["workers"], tasks)
            error = said / one["wall_s"] - 1
            rows.append({k: one[k] for k in ("stage", "frames", "workers", "wall_s")})
            rows[-1] |= {"predicted_s": said, "relative_error": error}
    return rows


def needs(measured: Sequence[Mapping[str, Any]], frames: float) -> list[dict[str, Any]]:
    """Of each stage for so many frames: core hours, hours of one process, nodes for a day."""
    rows = []
    for stage in dict.fromkeys(one["stage"] for one in measured):
        small, *_, large = sorted(
            (one for one in measured if (one["stage"], one["workers"]) == (stage, 1)),
            key=lambda one: one["frames"],
        )
        model = StageModel.of(small, large)
        shared, alone = sum(line(frames) for line in model.busy.values()), model.alone(frames)
        rows.append(
            {
                "stage": stage,
                "core_hours": (shared + alone) / 3600,
                "alone_hours": alone / 3600,
                "nodes_for_a_day": nodes_for(shared, alone, DAY_S),
            }
        )
    return rows


def nodes_for(shared_s: float, alone_s: float, within_s: float) -> int | None:
    """Nodes of 64 cores that end in time; None if one process alone takes longer."""
    if alone_s >= within_s:
        return None
    return max(1, math.ceil(shared_s / (CORES_A_NODE * (within_s - alone_s))))
