"""Run the engines on checks and compare each tensor with the reference's.

Tolerances are relative to the largest number of the reference's tensor, because rounding errors of
the large terms in a sum also affect its small results.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.engine import DTypeName, Tensors, load_tensors
from bridge.runs.workers import progress
from dsnet.verify.engines import (
    REFERENCE,
    Check,
    EngineResult,
    RunEngine,
    run_engine,
    write_requests,
)

TOLERANCES = {
    "FLOAT64": 1e-10,
    "FLOAT32_FORWARD": 1e-5,
    "FLOAT32_GRADIENT": 1e-4,
    "BFLOAT16_FORWARD": 3e-2,
    "BFLOAT16_GRADIENT": 1e-1,
}
"""Largest differences relative to the tensor's scale; docs/verification.md says why."""
CAUSES = {
    "layers": "layer {layer}",
    "loss": "the loss",
    "gradients": "backward pass of layer {layer}",
    "moments": "Adam's moments, first of {parameter}",
    "statistics": "running statistics {parameter}",
    "weights": "Adam's update (its moments agree), first of {parameter}",
    "losses": "the losses of later steps",
    "descent": "the descent's closest iterates, first of {layer}",
    "stock descent": "those of torch.optim.SGD with autograd, first of {layer}",
}
"""Sentences by kind of part, in the order in which a mistake becomes visible."""


@dataclass(frozen=True)
class Row:
    """One part of one check, in one engine and precision."""

    check: str
    part: str
    """`layers`, `loss`, `gradients`, `moments after n`, `weights after n`, `statistics after n`,
    `losses` (before each step), `descent`, `stock descent` (their closest iterates)."""
    engine: str
    dtype: DTypeName
    max_abs: float
    """Largest difference of all the part's tensors."""
    max_rel: float
    """Largest difference relative to the scale of its own tensor."""
    tensor: str
    """The tensor that has `max_rel`."""
    index: tuple[int, ...]
    """Where in that tensor it is."""
    tolerance: float
    passed: bool
    first: str = ""
    """The first tensor, in the order of computation, that differs by more than the tolerance."""
    problem: str = ""
    """Why there was nothing to compare."""


@dataclass(frozen=True)
class Skipped:
    """A check that an engine was not asked, in one precision."""

    check: str
    engine: str
    dtype: DTypeName
    reason: str


def skipped_rows(checks: Iterable[Check], results: Mapping[str, EngineResult]) -> list[Skipped]:
    """What this machine could not compare."""
    return [
        Skipped(check.name, engine, dtype, results[engine].missing)
        for check in checks
        for engine, dtypes in check.engines.items()
        if results[engine].missing
        for dtype in dtypes
    ]


def verify(
    checks: Sequence[Check],
    folder: Path,
    run: RunEngine = run_engine,
) -> tuple[list[Row], dict[str, EngineResult]]:
    """Run some checks on their engines; gives all rows, and the result of each engine.

    An engine that this machine cannot have (`EngineResult.missing`) has no rows.
    `folder`, which must be empty, receives requests and results.
    """
    engines = dict.fromkeys([REFERENCE, *(name for check in checks for name in check.engines)])
    write_requests(folder / "request", dict.fromkeys(engines, checks))
    results = {
        engine: run(engine, folder / "request", folder / engine)
        for engine in progress(list(engines), what="engines", unit="engine")
    }
    rows = [
        row
        for check in checks
        for engine, dtypes in check.engines.items()
        for dtype in dtypes
        if not results[engine].missing
        for row in _rows_of(check, engine, dtype, results)
    ]
    return rows, results


def _rows_of(
    check: Check, engine: str, dtype: DTypeName, results: Mapping[str, EngineResult]
) -> Iterator[Row]:
    sides: list[tuple[str, DTypeName]] = [(engine, dtype), (REFERENCE, "float64")]
    for name, precision in sides:
        if problem := results[name].why_missing(check, precision):
            failed = (np.inf, np.inf, "", (), 0.0, False, "", problem)
            yield Row(check.name, "all", name, precision, *failed)
            return
    actual = load_tensors(results[engine].path(check, dtype))
    expected = load_tensors(results[REFERENCE].path(check, "float64"))
    yield from compare(check, engine, dtype, expected, actual)


def compare(
    check: Check, engine: str, dtype: DTypeName, expected: Tensors, actual: Tensors
) -> Iterator[Row]:
    """Rows for all tensors of one case; `expected` is in the order of computation."""
    parts: dict[str, list[str]] = {}
    for name in expected:
        if name not in check.leave_out:
            parts.setdefault(part_of(name), []).append(name)
    for part, names in parts.items():
        limit = tolerance_of(part, dtype)
        differences = {n: _difference(expected[n], actual.get(n), dtype) for n in names}
        worst = max(differences, key=lambda name: differences[name].max_rel)
        max_abs = max(difference.max_abs for difference in differences.values())
        _, max_rel, index, _ = differences[worst]
        first = next((name for name in names if not differences[name].max_rel <= limit), "")
        verdict = (limit, not first, first, differences[first].problem if first else "")
        yield Row(check.name, part, engine, dtype, max_abs, max_rel, worst, index, *verdict)


class _Difference(NamedTuple):
    max_abs: float
    max_rel: float
    index: tuple[int, ...]
    problem: str = ""


def _difference(
    expected: NDArray[Any], actual: NDArray[Any] | None, dtype: DTypeName
) -> _Difference:
    if actual is None:
        return _Difference(np.inf, np.inf, (), "no such tensor")
    stored = "float32" if dtype == "bfloat16" else dtype
    if (expected.shape, stored) != (actual.shape, actual.dtype):
        problem = f"{actual.dtype} {actual.shape} for {stored} {expected.shape}"
        return _Difference(np.inf, np.inf, (), problem)
    difference = np.abs(actual.astype(np.float64) - expected)
    # Treat NaN as infinitely far off: comparisons with NaN are false and would hide it.
    difference[~np.isfinite(difference)] = np.inf
    index = tuple(int(k) for k in np.unravel_index(np.argmax(difference), difference.shape))
    largest, scale = float(difference[index]), float(np.abs(expected).max())
    relative = largest / scale if scale and np.isfinite(largest) else np.inf if largest else 0.0
    return _Difference(largest, relative, index)


def part_of(tensor: str) -> str:
    """The part (see `Row.part`) that a tensor belongs to, from its name."""
    if step := re.fullmatch(r"step_(\d+)/(weight|adam_m|adam_v)/(.*)", tensor):
        count, state, name = step.groups()
        if state == "weight":
            return f"{'statistics' if '/moving_' in name else 'weights'} after {count}"
        return f"moments after {count}"
    kind = tensor.partition("/")[0]
    return {"layer": "layers", "grad": "gradients"}.get(kind, kind)


def tolerance_of(part: str, dtype: DTypeName) -> float:
    """The tolerance of a part, relative to the tensor's scale."""
    if dtype == "float64":
        return TOLERANCES["FLOAT64"]
    kind = "FORWARD" if part in ("layers", "loss", "losses") else "GRADIENT"
    return TOLERANCES[f"{dtype.upper()}_{kind}"]


def diagnose(rows: Iterable[Row]) -> dict[str, list[str]]:
    """The likely causes of failed rows as sentences, with the checks that show each.

    Only the first part of a check that failed is reported, as all later ones depend on it. A loss
    is reported only if no layer of that engine differs.
    """
    causes: dict[str, list[str]] = {}
    failed = [row for row in rows if not row.passed]
    for (check, engine, dtype), group in groupby(failed, lambda r: (r.check, r.engine, r.dtype)):
        first = min(group, key=_order)
        causes.setdefault(f"{engine}: {_cause(first)}", []).append(f"{check} {dtype}")
    explained = {cause.partition(":")[0] for cause in causes if ": layer " in cause}
    return {
        cause: checks
        for cause, checks in causes.items()
        if not (cause.endswith(": the loss") and cause.partition(":")[0] in explained)
    }


def _order(row: Row) -> tuple[int, int]:
    """Sort key: the order in which a mistake becomes visible."""
    kind, _, count = row.part.partition(" after ")
    # Losses depend on the weights after the first step, so they come after those.
    return int(count or kind == "losses"), [*CAUSES, "all"].index(kind)


def _cause(row: Row) -> str:
    if row.part == "all":
        return f"no result, {row.problem}"
    # `layer/lstm`, `grad/lstm/kernel`, `step_1/adam_m/lstm/kernel`
    kind, _, name = row.first.partition("/")
    parameter = name.partition("/")[2]
    layer = re.split(r"/|\.(?=weight$|bias$)", name)[0] if kind == "grad" else name
    cause = CAUSES[row.part.partition(" after ")[0]]
    cause = cause.format(layer=layer, parameter=parameter)
    return f"{cause} ({row.problem})" if row.problem else cause
