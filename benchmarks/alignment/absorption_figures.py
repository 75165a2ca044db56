"""What aligners take from the offsets, as bars and bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bridge.runs.artifact import DataOrigin
from dsnet.pictures.panels import (
    draw_panels,
    magnitude_colours,
    new_figure,
    save_figure,
    scale_top_m,
)
from dsnet.pictures.render import frame_camera, render_bodies

_LEAST_SHARE_DRAWN = 0.02
# Clear of curves and bars, wherever they end.
_LEGEND_ABOVE: dict[str, Any] = {
    "fontsize": 8,
    "frameon": False,
    "ncols": 4,
    "loc": "lower left",
    "bbox_to_anchor": (0, 1),
}


@dataclass(frozen=True)
class Drawn:
    """An aligner in the figures, the same in all of them."""

    label: str
    """Its name."""
    colour: str
    """Of its lines and bars."""
    line: str = "-"
    """Line style."""


def draw_absorption(
    path: Path, summaries: Mapping[Drawn, Mapping[str, Any]], *, title: str, origin: DataOrigin
) -> None:
    """Bars for each body part that moves: what was absorbed, and what was invented.

    Parameters
    ----------
    summaries : `Absorption.summary` of each aligner, on the same sequences.
    """
    first = next(iter(summaries.values()))["parts"]
    parts = [name for name, part in first.items() if part["share"] >= _LEAST_SHARE_DRAWN]
    figure = new_figure(9.0, 1.6 + 0.42 * len(parts), title=title, origin=origin)
    absorbed, invented = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(parts))
    height = 0.8 / len(summaries)
    for number, (one, summary) in enumerate(summaries.items()):
        place = rows + (number - (len(summaries) - 1) / 2) * height
        own = [summary["parts"][name] for name in parts]
        look = {"color": one.colour, "label": one.label}
        absorbed.barh(place, [100 * part["absorbed"] for part in own], height, **look)
        invented.barh(place, [part["invented_mm"] for part in own], height, **look)
    names = [f"{name.replace('_', ' ')}, {first[name]['true_mm']:.1f} mm" for name in parts]
    absorbed.set_yticks(rows, names, fontsize=8)
    absorbed.invert_yaxis()
    absorbed.axvline(0, color="black", linewidth=0.6)
    _tidy(absorbed, "body part, RMS of its true offsets")
    absorbed.set_xlabel("absorbed by pose and shape [%]", fontsize=9)
    _tidy(invented, "")
    invented.set_xlabel("invented, RMS [mm]", fontsize=9)
    invented.legend(**_LEGEND_ABOVE)
    save_figure(figure, path)


def draw_error_bodies(
    path: Path,
    vertices_m: NDArray[np.floating],
    faces: NDArray[np.integer],
    true_m: NDArray[np.floating],
    errors_m: Mapping[Drawn, NDArray[np.floating]],
    *,
    title: str,
    origin: DataOrigin,
    panel_px: int = 420,
) -> None:
    """A body from both sides, coloured by the true offsets and by each aligner's errors.

    Parameters
    ----------
    vertices_m : (V, 3) the body to draw.
    true_m : (V,) root mean square of the true offsets.
    errors_m : (V,) root mean square of the offsets' errors, of each aligner.
    """
    top_m = scale_top_m(true_m)
    magnitudes_m = [true_m, *errors_m.values()]
    rows = [
        _bodies(vertices_m, faces, magnitudes_m, top_m, azimuth_deg, panel_px)
        for azimuth_deg in (20.0, 200.0)
    ]
    draw_panels(
        path,
        rows,
        title=title,
        origin=origin,
        column_titles=["true offsets", *(f"error, {one.label}" for one in errors_m)],
        row_titles=["front", "back"],
        colour_top_m=top_m,
        colour_label="root mean square",
    )


def _bodies(
    vertices_m: NDArray[np.floating],
    faces: NDArray[np.integer],
    magnitudes_m: Sequence[NDArray[np.floating]],
    top_m: float,
    azimuth_deg: float,
    panel_px: int,
) -> list[NDArray[np.uint8]]:
    camera = frame_camera([vertices_m], height_px=panel_px, azimuth_deg=azimuth_deg)
    return [
        render_bodies(
            [vertices_m],
            faces,
            camera=camera,
            colours=[magnitude_colours(magnitude_m, top_m)],
        )
        for magnitude_m in magnitudes_m
    ]


def _tidy(axes: Axes, y: str) -> None:
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, linewidth=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
