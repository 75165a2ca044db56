"""What was measured of many processes and many sequences.

What measured it is in commit b9aa1159 and no longer in the tree.
"""

from __future__ import annotations

from typing import Any

from benchmarks.many_sequences import as_page
from benchmarks.scaling.limits import limits
from benchmarks.scaling.model import CORES_A_NODE, needs, predicted_and_measured
from tools.pages.blocks import load, table

SEQUENCES, FRAMES_EACH = 1_000_000, 321
"""The mean length is that of the paper's corpus."""
RUNS = 10
"""Into so many the corpus is cut, for comparison: each is below what breaks one."""


def page() -> str:
    """docs/results/scaling/scaling.md."""
    scaling = load("scaling/scaling")
    return (
        "# More than one machine: measured\n\nWritten by `python -m tools.update_pages`; "
        f"[what it means](../../scaling.md).\n\n{_measured(scaling)}{_needed(scaling)}\n"
        f"## Many short sequences\n\n{as_page(load('scaling/many_sequences'))}"
    )


def _measured(scaling: dict[str, Any]) -> str:
    rows = [
        (one["stage"], one["frames"], one["workers"], f"{one['wall_s']:.1f}",
         f"{one['frames'] / one['wall_s']:.0f}", *_tasks(one))
        for one in scaling["measured"]
    ]  # fmt: skip
    checked = [
        (row["stage"], row["frames"], row["workers"], f"{row['wall_s']:.1f}",
         f"{row['predicted_s']:.1f}", f"{100 * row['relative_error']:+.0f} %")
        for row in predicted_and_measured(scaling["measured"])
    ]  # fmt: skip
    pools = [
        (one["kind"], one["workers"] or "all cores", f"{one['begin_s']:.2f}",
         f"{1e3 * one['task_s']:.2f}")
        for one in scaling["overheads"]
    ]  # fmt: skip
    return (
        f"Settings of `{scaling['profile']}`, on {scaling['machine']}. Bytes of a task: read and "
        "written by files, and to and from the process that asks, if a task leaves it.\n\n"
        + table("stage | frames | workers | seconds | frames a second | tasks | "
                 "seconds a task | kB read | kB written | kB to and fro", rows)
        + "\nWhat a pool takes when there is nothing to do:\n\n"
        + table("pool | workers | seconds to begin | ms a task", pools)
        + "\nThe model, drawn through the smallest and the largest corpus with one worker, at "
        "the others:\n\n"
        + table("stage | frames | workers | seconds | predicted | error", checked)
    )  # fmt: skip


def _tasks(one: dict[str, Any]) -> tuple[str, ...]:
    """Tasks, and seconds and kilobytes of one."""
    phases = one["phases"].values()
    count = sum(phase["tasks"] for phase in phases)

    def each(*keys: str) -> float:
        return sum(phase[key] for phase in phases for key in keys) / max(count, 1)

    kilobytes = (("read_bytes",), ("written_bytes",), ("sent_bytes", "back_bytes"))
    return (
        str(count),
        f"{each('busy_s'):.3f}",
        *(f"{1e-3 * each(*keys):,.0f}" for keys in kilobytes),
    )


def _needed(scaling: dict[str, Any]) -> str:
    whole = SEQUENCES * FRAMES_EACH
    rows = [
        (row["stage"], f"{row['core_hours']:,.0f}", f"{row['alone_hours']:,.0f}",
         row["nodes_for_a_day"] or "none suffice", _each(a_run["nodes_for_a_day"]))
        for row, a_run in zip(
            needs(scaling["measured"], whole), needs(scaling["measured"], whole / RUNS), strict=True
        )
    ]  # fmt: skip
    broken = [
        (row["what"], f"{row['sequences']:,.0f}", row["remedy"])
        for row in limits(scaling, FRAMES_EACH)
    ]
    return (
        f"\n## {SEQUENCES:,} sequences\n\nOf {FRAMES_EACH} frames each, the paper's mean, by the "
        f"same lines; nodes of {CORES_A_NODE} cores as fast as these:\n\n"
        + table(
            f"stage | core hours | of these in one process | nodes for a day | as {RUNS} runs", rows
        )
        + "\nWhat breaks, the first first:\n\n"
        + table("what | at sequences | remedy", broken)
    )


def _each(nodes: int | None) -> str:
    return f"{RUNS} x {nodes}" if nodes else "none suffice"


def many_motions() -> str:
    """What a folder of motions takes in each form, for docs/motion_files.md."""
    found = load("scaling/folders")
    whole, long = found["forms"]["offsets"], found["long"]
    minutes = long["frames"] // 3600
    rows = [
        [
            f"`{form}`",
            f"{one['bytes_a_frame'] / 1e3:.1f}",
            f"{one['bytes_a_frame'] * found['amass_frames'] / 1e9:,.0f}",
            f"{one['frames_per_cpu_s']:,.0f}",
            "mapped" if one is whole else f"{one['read_frames_per_cpu_s']:,.0f}",
            "0" if one is whole else f"{one['most_um']:.0f} ({100 * one['rms_share']:.2f} %)",
        ]
        for form, one in found["forms"].items()
    ]
    return (
        table(
            "form | kB a frame | GB for 40 hours | frames/s written | frames/s read | off by, µm "
            "(share)",
            rows,
        )
        + f"\nLargest offset {whole['largest_offset_mm']:.0f} mm; shares are of root mean squares."
        " Frames a second of one core's time, the start of the\ncommand included. "
        f"{minutes} minutes of motion, {long['frames']:,} frames, took `nodes16` "
        f"{long['cpu_s'] / 60:.1f} minutes of one core ({long['frames_per_cpu_s']:,.0f} frames/s) "
        f"and\n{long['bytes'] / 1e6:,.0f} MB. {found['machine']}; "
        "[measured](results/scaling/folders.json) by `python -m benchmarks.flesh_folders --minutes "
        f"{minutes}` while\nothers used the machine: times are upper bounds.\n"
    )
