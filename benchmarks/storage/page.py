"""docs/results/storage/storage.md."""

from __future__ import annotations

from itertools import groupby
from typing import Any

_HEAD = """# Storage

Made by `python -m benchmarks.storage --run {run} --clips {clips}{untimed}`. Data: {data}. Of each
kind {clips} sequences, {frames} frames in the middle of each. A frame is 6890 vertices of three
float32. A bound holds for every coordinate; where there is none, errors are as they happen to be.
Subspaces are fitted to the run; all of its frames share the directions' bytes. {speed}
"""


def page(results: dict[str, Any]) -> str:
    """The whole page: one table for each kind of vertices."""
    machine = results["machine"]
    speed = (
        f"Speeds in megabytes of float32 a second, one thread, on {machine}."
        if machine
        else "Speeds were not taken."
    )
    untimed = "" if machine else " --no-timed"
    text = _HEAD.format(
        speed=speed, untimed=untimed, **{k: results[k] for k in ("run", "data", "clips", "frames")}
    )
    for source, rows in groupby(results["rows"], key=lambda row: row["source"]):
        text += f"\n## {source[0].upper()}{source[1:]}\n\n{_table(list(rows), bool(machine))}"
    return text


def _table(rows: list[dict[str, Any]], timed: bool) -> str:
    columns = ["stored as", "bound, mm", "bytes a frame", "ratio", "largest error, mm", "mean, mm"]
    columns += ["write, MB/s", "read, MB/s"] if timed else []
    lines = [" | ".join(columns), "|".join(["---", *["---:"] * (len(columns) - 1)])]
    for row in rows:
        bound = {None: "", 0.0: "exact"}.get(row["bound_mm"], f"{row['bound_mm']}")
        cells = [row["label"], bound, f"{row['bytes_per_frame']:,.0f}", f"{row['ratio']:.1f}"]
        cells += [f"{row['largest_mm']:.2g}", f"{row['mean_mm']:.2g}"]
        cells += [f"{row[k]:.0f}" for k in ("encode_mb_s", "decode_mb_s") if timed]
        lines.append(" | ".join(cells))
    return "".join(f"| {line} |\n" for line in lines)
