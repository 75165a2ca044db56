"""What markers say of a prediction, as a table, a figure and numbers in JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from bridge.markers.segments import CUT_HZ
from bridge.markers.skin import BANDS_HZ, Comparison, Row
from bridge.report.panels import save_figure

FOOTER = "markers: measured on a person; body and its flesh: a model"


def write_comparisons(
    path_of: Callable[[str], Path], comparisons: Mapping[str, Comparison], fps: float
) -> None:
    """Write `markers.json`, `markers.md` and `markers.png`.

    Parameters
    ----------
    path_of : where a file of a name is written.
    comparisons : of the same markers, by the pose that the body takes.
    """
    found = {name: comparison.summary() for name, comparison in comparisons.items()}
    path_of("markers.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    text = "\n\n".join(table(name, comparison) for name, comparison in comparisons.items())
    path_of("markers.md").write_text(f"{_HEAD}\n\n{text}\n", encoding="utf-8")
    draw(path_of("markers.png"), comparisons, fps)


_HEAD = f"""# Prediction beside skin markers

Motion of each marker in its segment's frame above {CUT_HZ} Hz, vertical: peak to peak of the
marker, of the body without offsets (pose alone) and with them; R² of the offsets with the pose's
part taken off (`flesh`), of the whole, and of the pose alone. Where that last is near 1 on a soft
spot, the pose was fitted to flesh, and right offsets count twice. Energy: percent from
{", ".join(f"{low} to {high}" for low, high in BANDS_HZ)} Hz. Rows with * are indicative."""


def table(name: str, comparison: Comparison) -> str:
    """Rows of Markdown, and what the method cannot see."""
    rows = "\n".join(_line(row) for row in comparison.rows)
    floor = max((size[1] for size in comparison.floor_mm.values()), default=0.0)
    doubts = {row.doubt: [] for row in comparison.rows if row.doubt}
    for row in comparison.rows:
        if row.doubt and row.segment not in doubts[row.doubt]:
            doubts[row.doubt].append(row.segment)
    said = "\n".join(f"\n\\* {', '.join(names)}: {doubt}" for doubt, names in doubts.items())
    return (
        f"## {name}\n\n"
        "| region | marker | seen | rms [mm] | peak to peak [mm] | pose alone | with offsets "
        "| marker's energy | offsets' energy | R² flesh | R² flesh, 3D | R² whole | R² pose alone "
        "| early [ms] |\n|---|---|" + "---:|" * 12 + f"\n{rows}\n\n"
        f"Markers on bone in the frame of the others move by up to {floor:.1f} mm rms vertically: "
        f"what the method cannot see.\n{said}"
    )


def _line(row: Row) -> str:
    real, added = (
        " ".join(f"{100 * part:.0f}" for part in size.energy) for size in (row.real, row.predicted)
    )
    return (
        f"| {row.region}{'*' if row.doubt else ''} | {row.label} | {row.seen:.2f} "
        f"| {row.real.rms_mm[1]:.0f} | {row.real.peak_to_peak_mm[1]:.0f} "
        f"| {row.pose_peak_to_peak_up_mm:.0f} | {row.total_peak_to_peak_up_mm:.0f} "
        f"| {real} | {added} "
        f"| {row.flesh_r2_up:.2f} | {row.flesh_r2:.2f} | {row.total_r2_up:.2f} "
        f"| {row.pose_r2_up:.2f} | {row.lag_ms:.0f} |"
    )


def draw(path: Path, comparisons: Mapping[str, Comparison], fps: float) -> None:
    """Curves of the first marker of each region: one column for each pose."""
    from matplotlib.figure import Figure

    first: dict[str, Row] = {}
    for row in next(iter(comparisons.values())).rows:
        first.setdefault(row.region, row)
    figure = Figure(
        figsize=(5.2 * len(comparisons), 1.3 * len(first) + 0.9), dpi=150, layout="constrained"
    )
    figure.suptitle("Skin markers and prediction, vertical, in the segment's frame", fontsize=11)
    figure.supxlabel(f"time [s]\n{FOOTER}", fontsize=8)
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
