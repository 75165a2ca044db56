"""The study of the paper's aligner, written as a page and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import ScalarFormatter

from bridge.results.panels import new_figure, save_figure

# Okabe and Ito's colours, told apart by every reader.
_COLOURS = {"true": "#0072B2", "frame 1": "#D55E00"}
_SHAPES = {"true": "true shapes", "frame 1": "shapes from frame 1"}
_KINDS = {
    "fixed": ("the paper's SGD", "-o"),
    "patience": ("stopped when no closer", "--s"),
    "decayed": ("rate falling to zero (departure)", ":^"),
}
_ERRORS = {
    "r2": "R² of the offsets",
    "pose_deg": "pose error [deg]",
    "mesh_mm": "distance to the mesh [mm]",
}
_DIGITS = {"r2": 2, "pose_deg": 2, "mesh_mm": 2}


def markdown(results: dict[str, Any]) -> str:
    """A page with one table: a row for each rule."""
    provenance = results["provenance"]
    return "\n".join(
        [
            "# The paper's aligner against its steps",
            "",
            f"Synthetic data: {_frames(results)} frames of {', '.join(results['clips'])}, whose truth",
            f"is known. Made in {provenance['wall_time_s'] / 60:.0f} minutes on",
            f"{provenance['machine']} by `{' '.join(provenance['command'])}`.",
            "",
            *_table(results["rules"]),
            "",
            "R² of the offsets against the truth, mean error of the joints' rotations, mean distance",
            "of the posed body from the mesh; *frame 1* with the shapes that the same descent found in",
            f"frame 1 ({results['betas_rms_frame_1']:.2f} from the true coefficients, root mean square).",
            "",
            "![Errors against steps](convergence.png)",
            "",
        ]
    )


def _table(rows: Sequence[dict[str, Any]]) -> list[str]:
    shapes = list(_SHAPES)
    columns = [f"{title}, {_SHAPES[shape]}" for title in _ERRORS.values() for shape in shapes]
    lines = [f"| a frame ends | steps | {' | '.join(columns)} |", "|---" * (2 + len(columns)) + "|"]
    for true, found in zip(rows[::2], rows[1::2], strict=True):
        steps = sorted({f"{row['mean_steps']:.0f}" for row in (true, found)}, key=float)
        values = [f"{row[error]:.{_DIGITS[error]}f}" for error in _ERRORS for row in (true, found)]
        lines.append(f"| {_ending(true)} | {' to '.join(steps)} | {' | '.join(values)} |")
    return lines


def _ending(row: dict[str, Any]) -> str:
    return {
        "fixed": f"after {row['steps']} steps",
        "decayed": f"after {row['steps']} steps, the rate falling to zero (departure)",
        "patience": f"{row['patience']} steps without coming closer, {row['steps']} at most",
    }[row["kind"]]


def _frames(results: dict[str, Any]) -> int:
    return len(results["clips"]) * results["config"]["frames"]


def draw_convergence(path: Path, results: dict[str, Any]) -> None:
    """One panel an error, against the steps that a frame took on average."""
    figure = new_figure(
        11.0,
        4.4,
        title=f"The paper's aligner against its steps, {_frames(results)} frames with known truth",
        origin="synthetic",
    )
    panels = figure.subplots(1, len(_ERRORS))
    for axes, error in zip(panels, _ERRORS, strict=True):
        _draw(axes, results["rules"], error)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    save_figure(figure, path)


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
    axes.set_ylabel(_ERRORS[error])
    if error == "r2":
        axes.set_ylim(-1.0, 1.0)
    else:
        axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
