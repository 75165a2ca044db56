"""The table of how the stages grow with the number of sequences, where each is short.

At commit `b9aa1159` this module still made the corpora and ran the stages. It measured CPU time at
N and at 2 N sequences, which should double. Where it grows by more than the stored limit, the
row is marked.
"""

from __future__ import annotations

from typing import Any


def growth(stage: dict[str, Any]) -> float:
    """Of the time beyond the start, from N to 2 N sequences."""
    few, many = (one["cpu_s"] - stage["start_s"] for one in stage["measured"])
    return many / max(few, 1e-9)


def as_page(result: dict[str, Any]) -> str:
    """The results as Markdown."""
    few, many = result["sequences"]
    least, most = result["frames"]
    lines = [
        f"Measured by `{result['command']}`, of commit `b9aa1159` and no longer in the tree: "
        f"smooth functions in place of motions and offsets, {least} to {most} frames a sequence, "
        f"as little training as a stage allows. CPU seconds beyond the imports; "
        f"{result['machine']}.",
        "",
        f"| stage | {few:,} sequences [s] | {many:,} sequences [s] | growth "
        "| anonymous memory [MB] | with mapped files [MB] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for name, stage in result["stages"].items():
        own_s = [f"{one['cpu_s'] - stage['start_s']:.1f}" for one in stage["measured"]]
        memory = [
            " to ".join(f"{one[key]:,.0f}" for one in stage["measured"])
            for key in ("anonymous_mb", "resident_mb")
        ]
        found = growth(stage)
        mark = " **too steep**" if found > result["limit"] else ""
        cells = [f"`{name}`", *own_s, f"{found:.1f}{mark}", *memory]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
