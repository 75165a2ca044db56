"""The heat map of `dsnet verify`: how far below its tolerance each engine stays, check by check."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from bridge.report.panels import new_figure, save_figure
from bridge.runs.artifact import DataOrigin

_DIGITS_SHOWN = 7
_FAILED = "#D55E00"
_COLOURS = ListedColormap(colormaps["YlGnBu"](np.linspace(0.08, 0.75, 2 * _DIGITS_SHOWN)))
_COLOURS.set_under(_FAILED)
_COLOURS.set_bad("#f2f2f2")
_SHORT = {"float64": "f64", "float32": "f32"}
Rows = Sequence[Mapping[str, Any]]


def draw_parity(path: Path, parity: Mapping[str, Any], origin: DataOrigin) -> None:
    """One cell a check, part, engine and precision.

    The colour is the number of digits between difference and tolerance, orange where there is
    none; the number is the exponent of the difference relative to the tensor's scale.
    """
    rows = parity["rows"]
    dsnet = [row for row in rows if row["check"].startswith("dsnet")]
    sides = [dsnet, [row for row in rows if row not in dsnet]]
    tallest = max(len(_labels(side)) for side in sides)
    verdict = "all within tolerance" if parity["passed"] else "NOT all within tolerance"
    figure = new_figure(
        10.0,
        1.9 + 0.155 * tallest,
        title=f"Difference from the float64 reference: {verdict}",
        origin=origin,
    )
    panels = figure.subplots(1, 2)
    for axes, side in zip(panels, sides, strict=True):
        _draw(axes, side)
    place = {"location": "top", "fraction": 0.02, "pad": 0.01, "aspect": 50}
    bar = figure.colorbar(panels[0].collections[0], ax=list(panels), **place)
    bar.set_label("digits between difference and tolerance (orange: over it)", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    save_figure(figure, path)


def _labels(rows: Rows) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row["check"], row["part"]) for row in rows))


def _draw(axes: Axes, rows: Rows) -> None:
    labels = _labels(rows)
    columns = list(dict.fromkeys(map(_column, rows)))
    spare = np.full((len(labels), len(columns)), np.nan)
    for row in rows:
        place = labels.index((row["check"], row["part"])), columns.index(_column(row))
        spare[place] = digits_to_spare(row)
        axes.text(
            place[1] + 0.5, place[0] + 0.5, _exponent(row), fontsize=5.5, ha="center", va="center"
        )
    axes.pcolormesh(
        spare, cmap=_COLOURS, vmin=0, vmax=_DIGITS_SHOWN, edgecolors="white", linewidth=0.5
    )
    axes.set_yticks(np.arange(len(labels)) + 0.5, [" · ".join(pair) for pair in labels], fontsize=6)
    names = [f"{engine} {_SHORT[dtype]}" for engine, dtype in columns]
    axes.set_xticks(np.arange(len(columns)) + 0.5, names, fontsize=6, rotation=90)
    axes.tick_params(length=0)
    axes.invert_yaxis()


def _column(row: Mapping[str, Any]) -> tuple[str, str]:
    return row["engine"], row["dtype"]


def digits_to_spare(row: Mapping[str, Any]) -> float:
    """log10(tolerance / difference), below 0 for a row that failed."""
    if not row["passed"]:
        return -1.0
    if not row["max_rel"]:
        return float(_DIGITS_SHOWN)
    return math.log10(row["tolerance"] / row["max_rel"])


def _exponent(row: Mapping[str, Any]) -> str:
    if row["max_rel"] is None:
        return "x"
    return f"{math.floor(math.log10(row['max_rel']))}" if row["max_rel"] else "0"
