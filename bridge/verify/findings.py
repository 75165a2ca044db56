"""What rows say: a table for a terminal, and of those that failed the first thing that is wrong."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby

from bridge.verify.compare import Row

_COLUMNS = (
    "check",
    "part",
    "engine",
    "precision",
    "max abs",
    "max rel",
    "worst tensor",
    "index",
    "tolerance",
    "verdict",
)
_LEFT = {"check", "part", "engine", "precision", "worst tensor", "index", "verdict"}
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


def cells(row: Row) -> tuple[str, ...]:
    """One row, a text a column."""
    verdict = "ok" if row.passed else f"FAIL {row.problem or 'first: ' + row.first}"
    return (
        row.check,
        row.part,
        row.engine,
        row.dtype,
        f"{row.max_abs:.1e}",
        f"{row.max_rel:.1e}",
        row.tensor,
        ",".join(map(str, row.index)),
        f"{row.tolerance:.0e}" if row.tolerance else "bits",
        verdict,
    )


def text_table(rows: Sequence[Row]) -> str:
    """The table for a terminal, columns aligned."""
    lines = [_COLUMNS, *map(cells, rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(_COLUMNS))]

    def aligned(line: tuple[str, ...]) -> str:
        parts = (
            cell.ljust(width) if name in _LEFT else cell.rjust(width)
            for cell, width, name in zip(line, widths, _COLUMNS, strict=True)
        )
        return "  ".join(parts).rstrip()

    return "\n".join(map(aligned, lines))


def summary(rows: Sequence[Row], diagnosis: Mapping[str, Sequence[str]]) -> str:
    """How many rows hold; and of those that do not, what is wrong."""
    failed = sum(not row.passed for row in rows)
    if not failed:
        return f"all {len(rows)} rows hold"
    causes = [
        f"  {cause}\n    in {', '.join(sorted(set(checks)))}" for cause, checks in diagnosis.items()
    ]
    return "\n".join([f"{failed} of {len(rows)} rows FAIL; what differs first:", *causes])


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
