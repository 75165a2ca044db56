"""From rows that failed to what is wrong: the first thing, in the order of computation."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import groupby

from bridge.verify.compare import Row

_CAUSES = {
    "layers": "layer {layer}",
    "loss": "the loss",
    "gradients": "backward pass of layer {layer}",
    "moments": "Adam's moments, first of {parameter}",
    "statistics": "running statistics {parameter}",
    "weights": "Adam's update (its moments agree), first of {parameter}",
    "losses": "the losses of later steps",
    "files": "file format {format}: {parameter}",
}
_ORDER = list(_CAUSES)


def diagnose(rows: Iterable[Row]) -> dict[str, list[str]]:
    """What is wrong, as a sentence by engine, and the checks that say so.

    Of each check only the first part that failed counts, for all that comes after it must fail;
    and a loss only if no check of that engine has found a layer.
    """
    found: dict[str, list[str]] = {}
    failed = [row for row in rows if not row.passed]
    for (check, engine, dtype), group in groupby(failed, lambda r: (r.check, r.engine, r.dtype)):
        first = min(group, key=_place)
        found.setdefault(f"{engine}: {_cause(first)}", []).append(f"{check} {dtype}")
    explained = {cause.partition(":")[0] for cause in found if ": layer " in cause}
    return {
        cause: checks
        for cause, checks in found.items()
        if not (cause.endswith(": the loss") and cause.partition(":")[0] in explained)
    }


def _place(row: Row) -> tuple[int, int]:
    kind, _, count = row.part.partition(" after ")
    # Losses differ from the second step on, so after the first step's weights.
    return int(count or kind == "losses"), _ORDER.index(kind) if kind in _ORDER else -1


def _cause(row: Row) -> str:
    if row.part == "all":
        return f"no result, {row.problem}"
    # `layer/lstm`, `grad/lstm/kernel`, `step_1/adam_m/lstm/kernel`, `weight/keras/lstm/kernel`
    kind, _, name = row.first.partition("/")
    within, _, parameter = name.partition("/")
    layer = re.split(r"/|\.(?=weight$|bias$)", name)[0] if kind == "grad" else name
    cause = _CAUSES[row.part.partition(" after ")[0]]
    cause = cause.format(layer=layer, parameter=parameter, format=within)
    return f"{cause} ({row.problem})" if row.problem else cause
