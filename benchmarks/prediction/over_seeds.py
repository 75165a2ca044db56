"""Means over training seeds, and scores without the real motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import mean, stdev
from typing import Any

from bridge.motion.sequences import is_real_motion


def summary(values: Sequence[float | None], form: str) -> str:
    """Mean over seeds, with the standard deviation where there are several; empty if one lacks."""
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return ""
    spread = f" ± {form.format(stdev(known))}" if len(known) > 1 else ""
    return form.format(mean(known)) + spread


def is_real(sequence: Mapping[str, Any]) -> bool:
    """Whether a test sequence is a recorded motion with simulated tissue."""
    return is_real_motion(sequence["name"])


def without_real(score: Mapping[str, Any], cell: str) -> list[Mapping[str, Any]]:
    """The invented motions of a cell; none if no real one is beside them."""
    inside = [one for one in score["sequences"] if one["cell"] == cell]
    invented = [one for one in inside if not is_real(one)]
    return invented if len(invented) < len(inside) else []


def r2_of(rows: Sequence[tuple[int, float, float]]) -> float | None:
    """R² over sequences of (frames, rms of the error, rms of what there is), None for none."""
    missed, whole = (sum(row[0] * row[1 + part] ** 2 for row in rows) for part in (0, 1))
    return 1 - missed / whole if rows else None
