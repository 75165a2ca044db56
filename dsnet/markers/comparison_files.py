"""Files of a comparison with skin markers: a table, a figure, the numbers."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from dsnet.markers.lone import Alone
from dsnet.markers.segments import CUT_HZ
from dsnet.markers.skin import BANDS_HZ, Comparison, Row

_FOOTER = "markers: measured on a person; body and its flesh: a model"


def write_comparisons(
    path_of: Callable[[str], Path],
    comparisons: Mapping[str, Comparison],
    fps: float,
    alone: Alone | None = None,
) -> None:
    """Write `markers.json`, `markers.md` and `markers.png`, of markers that have no pose
    `markers_alone.png` too.

    Parameters
    ----------
    path_of : where a file of a name is written.
    comparisons : of the same markers, by the pose that the body takes.
    alone : what they do by themselves, if they have no pose beside them.
    """
    from dsnet.pictures.page_templates import fill_template

    tables: dict[str, Alone | Comparison] = {**comparisons}
    if alone is not None:
        tables = {"markers alone": alone, **tables}
    rows = {name: one.summary() for name, one in tables.items()}
    path_of("markers.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    settings = {"cut_hz": CUT_HZ, "bands_hz": BANDS_HZ}
    page = fill_template("markers.md.j2", comparisons=comparisons, alone=alone, **settings)
    path_of("markers.md").write_text(page, encoding="utf-8")
    if alone is not None:
        _draw_alone(path_of("markers_alone.png"), alone, fps)
    if comparisons:
        _draw(path_of("markers.png"), comparisons, fps)


def _draw_alone(path: Path, alone: Alone, fps: float) -> None:
    """Curves of the first marker of each region, along the three axes of its segment."""
    from matplotlib.figure import Figure

    from dsnet.pictures.panels import save_figure

    first = {row.region: row for row in reversed(alone.rows)}
    rows = [row for row in alone.rows if first[row.region] is row]
    figure = Figure(figsize=(6.4, 1.2 * len(rows) + 1.2), dpi=150, layout="constrained")
    figure.suptitle(f"Skin beyond bone, above {CUT_HZ} Hz, in the segment's frame", fontsize=11)
    figure.supxlabel("time [s]\nmarkers alone: measured on a person", fontsize=8)
    axes = figure.subplots(len(rows), 1, squeeze=False, sharex=True)[:, 0]
    colours = {"to the left": "#0072B2", "up": "black", "to the front": "#D55E00"}
    for axis, row in zip(axes, rows, strict=True):
        times = np.arange(len(row.fast_mm)) / fps
        for series, (way, colour) in zip(row.fast_mm.T, colours.items(), strict=True):
            axis.plot(times, series, color=colour, linewidth=1.1, label=way)
        axis.set_ylabel(f"{row.region}{'*' * bool(row.doubt)}\n{row.label} [mm]", fontsize=7)
        axis.tick_params(labelsize=7)
    axes[0].legend(fontsize=7, ncols=3, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1))
    save_figure(figure, path)


def _draw(path: Path, comparisons: Mapping[str, Comparison], fps: float) -> None:
    """Curves of the first marker of each region: one column for each pose."""
    # Errors of a run need no pictures, whose libraries take longer to load than the rest.
    from matplotlib.figure import Figure

    from dsnet.pictures.panels import save_figure

    first: dict[str, Row] = {}
    for row in next(iter(comparisons.values())).rows:
        first.setdefault(row.region, row)
    figure = Figure(
        figsize=(5.2 * len(comparisons), 1.3 * len(first) + 0.9), dpi=150, layout="constrained"
    )
    figure.suptitle("Skin markers and prediction, vertical, in the segment's frame", fontsize=11)
    figure.supxlabel(f"time [s]\n{_FOOTER}", fontsize=8)
    axes = figure.subplots(len(first), len(comparisons), squeeze=False, sharex=True, sharey="row")
    for column, (name, comparison) in enumerate(comparisons.items()):
        axes[0, column].set_title(name, fontsize=10, pad=18)  # the legend lies between
        for line, row in enumerate(first.values()):
            if (curves := comparison.curves.get(row.label)) is None:
                continue
            times = np.arange(len(curves.real)) / fps
            real = np.where(curves.good, curves.real, np.nan)
            axis = axes[line, column]
            axis.plot(times, real, color="black", linewidth=1.6, label="marker")
            axis.plot(times, curves.pose, ":", color="#777777", label="pose alone")
            axis.plot(times, curves.total, color="#D55E00", linewidth=1.1, label="with offsets")
            axis.tick_params(labelsize=7)
            if not column:
                star = "*" if row.doubt else ""
                axis.set_ylabel(f"{row.region}{star}\n{row.label} [mm]", fontsize=7)
    place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    axes[0, 0].legend(fontsize=7, ncols=3, frameon=False, **place)
    save_figure(figure, path)
