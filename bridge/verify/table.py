"""The rows as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
