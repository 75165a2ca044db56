"""docs/verification.md: how the last `dsnet verify` ended, and its picture."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from bridge.runs import Run
from bridge.runs.artifact import DataOrigin
from dsnet.pictures.panels import new_figure, save_figure
from dsnet.report.results import read_parity
from dsnet.verify.compare import Skipped
from dsnet.verify.stage_verify import skipped_text
from tools.pages.blocks import RESULTS, load

_DIGITS_SHOWN = 7
_SHADES = ListedColormap(colormaps["YlGnBu"](np.linspace(0.08, 0.75, 2 * _DIGITS_SHOWN)))
_PARITY_COLOURS = _SHADES.with_extremes(under="#D55E00", bad="#f2f2f2")
_SHORT = {"float64": "f64", "float32": "f32", "bfloat16": "bf16"}
Row = Mapping[str, Any]


def take_verification(run: Run) -> None:
    """Copy what `dsnet verify` found in a run, and draw it."""
    verified, target = run.artifact("verify"), RESULTS / "verify"
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for name in ("parity.json", "manifest.json"):
        shutil.copy2(verified.path / name, target / name)
    draw_parity(target / "parity.png", read_parity(verified), verified.origin)


def outcome() -> str:
    """How many rows hold; which command made them, on what, in how long."""
    made, parity = load("verify/manifest")["provenance"], load("verify/parity")
    rows, skipped = parity["rows"], [Skipped(**one) for one in parity.get("skipped", ())]
    versions = ", ".join(f"{name} {v}" for name, v in made["versions"].items())
    held = f"{sum(row['passed'] for row in rows)} of {len(rows)} rows hold{skipped_text(skipped)}"
    return (
        f"{held}: "
        f"`{' '.join(made['command'])}`, {made['wall_time_s']:.0f} s on {made['machine']};\n"
        f"{versions}.\n"
    )


def draw_parity(path: Path, parity: Mapping[str, Any], origin: DataOrigin) -> None:
    """What `dsnet verify` found: a field for each check, part, engine and precision.

    The colour is the number of digits between difference and tolerance, orange where there is
    none; the number is the exponent of the difference relative to the tensor's scale.
    """
    rows = parity["rows"]
    dsnet = [row for row in rows if row["check"].startswith("dsnet")]
    sides = [dsnet, [row for row in rows if row not in dsnet]]
    tallest = max(len({(row["check"], row["part"]) for row in side}) for side in sides)
    verdict = "all within tolerance" if parity["passed"] else "NOT all within tolerance"
    title = f"Difference from the float64 reference: {verdict}"
    figure = new_figure(10.0, 1.9 + 0.155 * tallest, title=title, origin=origin)
    panels = figure.subplots(1, 2)
    for axes, side in zip(panels, sides, strict=True):
        _draw_checks(axes, side)
    place = {"location": "top", "fraction": 0.02, "pad": 0.01, "aspect": 50}
    bar = figure.colorbar(panels[0].collections[0], ax=list(panels), **place)
    bar.set_label("digits between difference and tolerance (orange: over it)", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    save_figure(figure, path)


def _draw_checks(axes: Axes, rows: Sequence[Row]) -> None:
    checks = list(dict.fromkeys((row["check"], row["part"]) for row in rows))
    engines = list(dict.fromkeys((row["engine"], row["dtype"]) for row in rows))
    spare = np.full((len(checks), len(engines)), np.nan)
    for row in rows:
        y = checks.index((row["check"], row["part"]))
        x = engines.index((row["engine"], row["dtype"]))
        spare[y, x] = digits_to_spare(row)
        found = row["max_rel"]
        text = "x" if found is None else str(math.floor(math.log10(found))) if found else "0"
        axes.text(x + 0.5, y + 0.5, text, fontsize=5.5, ha="center", va="center")
    style = {"edgecolors": "white", "linewidth": 0.5}
    axes.pcolormesh(spare, cmap=_PARITY_COLOURS, vmin=0, vmax=_DIGITS_SHOWN, **style)
    axes.set_yticks(np.arange(len(checks)) + 0.5, [" · ".join(pair) for pair in checks], fontsize=6)
    names = [f"{engine} {_SHORT[dtype]}" for engine, dtype in engines]
    axes.set_xticks(np.arange(len(engines)) + 0.5, names, fontsize=6, rotation=90)
    axes.tick_params(length=0)
    axes.invert_yaxis()


def digits_to_spare(row: Row) -> float:
    """log10(tolerance / difference), below 0 for a row that failed."""
    if not row["passed"]:
        return -1.0
    if not row["max_rel"]:
        return float(_DIGITS_SHOWN)
    return math.log10(row["tolerance"] / row["max_rel"])
