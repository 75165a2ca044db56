"""One engine's tensors against the reference's: the rows of the table."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from bridge.verify.protocol import DTypeName
from bridge.verify.tolerances import tolerance_of

_STEP = re.compile(r"step_(\d+)/(weight|adam_m|adam_v)/(.*)")
Read = Callable[[str], Any]
"""Gives a tensor by its name, or None."""


@dataclass(frozen=True)
class Row:
    """One part of one check, in one engine and precision."""

    check: str
    part: str
    """`layers`, `loss`, `gradients`, `moments after n`, `weights after n`, `statistics after n`,
    `losses` (before each step), `files`."""
    engine: str
    dtype: DTypeName
    max_abs: float
    """Largest difference of all the part's tensors."""
    max_rel: float
    """Largest difference relative to the scale of its own tensor."""
    tensor: str
    """Where `max_rel` is."""
    index: tuple[int, ...]
    """Its place in that tensor."""
    tolerance: float
    passed: bool
    first: str = ""
    """The first tensor, in the order of computation, that differs by more than the tolerance."""
    problem: str = ""
    """Why there was nothing to compare."""


@dataclass(frozen=True)
class Difference:
    """Two tensors compared."""

    name: str
    max_abs: float
    max_rel: float
    index: tuple[int, ...]
    problem: str = ""


def part_of(tensor: str) -> str:
    """The row to which a tensor belongs."""
    kind = tensor.partition("/")[0]
    if step := _STEP.fullmatch(tensor):
        count, state, name = step.groups()
        if state == "weight":
            state = "statistics" if "/moving_" in name else "weights"
        return f"{'moments' if state.startswith('adam') else state} after {count}"
    names = {"layer": "layers", "grad": "gradients", "weight": "files"}
    return names.get(kind, kind)


def compare(
    check: str, engine: str, dtype: DTypeName, names: Sequence[str], expected: Read, found: Read
) -> list[Row]:
    """Rows for all tensors of one case.

    Parameters
    ----------
    names : the reference's tensors, first computed first.
    expected, found : the reference's, always float64, and the engine's.
    """
    part_places = {part: k for k, part in enumerate(dict.fromkeys(map(part_of, names)))}
    ordered = sorted(names, key=lambda name: part_places[part_of(name)])
    return [
        _row(check, part, engine, dtype, [_difference(n, expected, found, dtype) for n in group])
        for part, group in groupby(ordered, key=part_of)
    ]


def compare_files(
    check: str, engine: str, dtype: DTypeName, names: Sequence[str], expected: Read, found: Read
) -> Row:
    """The row of weights that came back from files: every bit counts, a zero's sign too."""

    def bits(name: str) -> Difference:
        difference = _difference(name, expected, found, dtype)
        if difference.problem or expected(name).tobytes() == found(name).tobytes():
            return difference
        return replace(difference, max_rel=np.inf, problem="not the same bits")

    return _row(check, "files", engine, dtype, [bits(name) for name in names])


def missing_row(check: str, engine: str, dtype: DTypeName, problem: str) -> Row:
    """The row of a case without a result."""
    return Row(check, "all", engine, dtype, np.inf, np.inf, "", (), 0.0, False, "", problem)


def _row(
    check: str, part: str, engine: str, dtype: DTypeName, differences: list[Difference]
) -> Row:
    limit = tolerance_of(part, dtype).limit
    worst = max(differences, key=lambda d: d.max_rel)
    first = next((d for d in differences if not d.max_rel <= limit), None)
    return Row(
        check,
        part,
        engine,
        dtype,
        max(d.max_abs for d in differences),
        worst.max_rel,
        worst.name,
        worst.index,
        limit,
        first is None,
        first.name if first else "",
        first.problem if first else "",
    )


def _difference(name: str, read_expected: Read, read_found: Read, dtype: DTypeName) -> Difference:
    expected, found = read_expected(name), read_found(name)
    if expected is None or found is None:
        return Difference(name, np.inf, np.inf, (), "no such tensor")
    if (expected.shape, dtype) != (found.shape, found.dtype):
        problem = f"{found.dtype} {found.shape} for {dtype} {expected.shape}"
        return Difference(name, np.inf, np.inf, (), problem)
    apart = np.abs(found.astype(np.float64) - expected)
    # A NaN is as far away as can be, and may not hide behind a comparison that is false.
    apart[~np.isfinite(apart)] = np.inf
    place = np.unravel_index(np.argmax(apart), apart.shape)
    largest, scale = float(apart[place]), float(np.abs(expected).max())
    relative = largest / scale if scale and np.isfinite(largest) else np.inf if largest else 0.0
    return Difference(name, largest, relative, tuple(int(k) for k in place))
