"""The study of the paper's aligner, written as a page and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import ScalarFormatter

from benchmarks.alignment.gravity import banner
from bridge.report.panels import new_figure, save_figure

# Okabe and Ito's colours, told apart by every reader.
_COLOURS = {"true": "#0072B2", "frame 1": "#D55E00"}
_SHAPES = {"true": "true shapes", "frame 1": "shapes from frame 1"}
_KINDS = {
    "fixed": ("the paper's SGD", "-o"),
    "patience": ("stopped when no closer", "--s"),
    "decayed": ("rate falling to zero (departure)", ":^"),
}
_ERRORS = {
    "r2": ("R²", "R² of the offsets"),
    "pose_deg": ("pose [deg]", "pose error [deg]"),
    "mesh_mm": ("mesh [mm]", "distance from the mesh [mm]"),
}
_PAGE = """\
# The paper's aligner against its steps (synthetic data)

{banner}{table}

R² of the offsets against the simulated truth, mean error of the joints' rotations and mean distance
of the posed body from the mesh, over {frames} frames. Each descent begins where that of the frame
before ended. The first of two numbers is with the true shapes, the second with those that the same
descent finds in frame 1: {betas_rms:.2f} from the true coefficients, root mean square.
Sequences: {clips}. Made in {minutes:.0f} minutes on {machine} by `{command}`.

![Errors against steps](convergence.png)
"""


def markdown(results: dict[str, Any]) -> str:
    """A page with one table, a row for each rule."""
    provenance = results["provenance"]
    return _PAGE.format(
        banner=banner(results),
        table="\n".join(_table(results["rules"])),
        frames=_frame_count(results),
        betas_rms=results["betas_rms_frame_1"],
        clips=", ".join(results["clips"]),
        minutes=provenance["wall_time_s"] / 60,
        machine=provenance["machine"],
        command=" ".join(provenance["command"]),
    )


def draw_convergence(path: Path, results: dict[str, Any]) -> None:
    """One panel an error, against the steps that a frame took on average."""
    figure = new_figure(
        13.0,
        4.0,
        title=f"The paper's aligner against its steps, {_frame_count(results)} frames",
        origin="synthetic",
    )
    panels = figure.subplots(1, len(_ERRORS))
    for axes, error in zip(panels, _ERRORS, strict=True):
        _draw(axes, results["rules"], error)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center", fontsize=8)
    save_figure(figure, path)


def _table(rows: Sequence[dict[str, Any]]) -> list[str]:
    columns = ["steps", *(title for title, _ in _ERRORS.values())]
    lines = [f"| a frame ends | {' | '.join(columns)} |", "|---" + "|---:" * len(columns) + "|"]
    # Rows come in pairs: true shapes, shapes from frame 1.
    for pair in zip(rows[::2], rows[1::2], strict=True):
        steps = dict.fromkeys(f"{row['mean_steps']:.0f}" for row in pair)
        values = [", ".join(f"{row[error]:.2f}" for row in pair) for error in _ERRORS]
        lines.append(f"| {_ending(pair[0])} | {' | '.join([', '.join(steps), *values])} |")
    return lines


def _ending(row: dict[str, Any]) -> str:
    return {
        "fixed": "after {steps} steps",
        "decayed": "after {steps} steps, the rate falling to zero (departure)",
        "patience": "{patience} steps without coming closer, or {steps} in all",
    }[row["kind"]].format(**row)


def _frame_count(results: dict[str, Any]) -> int:
    return len(results["clips"]) * results["config"]["frames"]


def _draw(axes: Axes, rows: Sequence[dict[str, Any]], error: str) -> None:
    for kind, (label, style) in _KINDS.items():
        for shape, colour in _COLOURS.items():
            chosen = [row for row in rows if (row["kind"], row["betas"]) == (kind, shape)]
            axes.plot(
                [row["mean_steps"] for row in chosen],
                [row[error] for row in chosen],
                style,
                color=colour,
                label=f"{label}, {_SHAPES[shape]}",
                markersize=4,
                linewidth=1.4,
            )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.set_xlabel("steps for each frame")
    axes.set_ylabel(_ERRORS[error][1])
    if error == "r2":
        axes.set_ylim(-1.0, 1.0)
    else:
        axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
