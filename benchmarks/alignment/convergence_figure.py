"""Errors of the paper's aligner against its steps for each frame, drawn."""

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


def draw_convergence(path: Path, rows: Sequence[dict[str, Any]], frames: int) -> None:
    """One panel an error, against the steps that a frame took on average; `rows` as in the JSON."""
    figure = new_figure(
        11.0,
        4.4,
        title=f"The paper's aligner against its steps, {frames} frames with known truth",
        origin="synthetic",
    )
    panels = figure.subplots(1, len(_ERRORS))
    for axes, error in zip(panels, _ERRORS, strict=True):
        _draw(axes, rows, error)
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
