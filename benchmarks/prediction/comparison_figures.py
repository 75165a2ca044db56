"""Figures of the comparison, drawn of its scores alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from benchmarks.prediction.comparison_page import BEST, NOTHING, systems_of
from bridge.motion.splits import CELLS
from bridge.paper import FPS
from dsnet.pictures.panels import new_figure, save_figure

Scores = Sequence[Mapping[str, Any]]
_LEAST, _MOST = 0.05, 20.0
_NEW, _KNOWN, _PLUS = "#b3541e", "#3b6ea5", "#1b7837"


def draw_figures(folder: Path, scores: Scores) -> None:
    """Write cost.png, cells.png and over_time.png."""
    corpora = dict.fromkeys(score["corpus"] for score in scores)
    of = {corpus: [s for s in scores if s["corpus"] == corpus] for corpus in corpora}
    _draw_cost(folder / "cost.png", of)
    _draw_cells(folder / "cells.png", of)
    _draw_over_time(folder / "over_time.png", next(iter(of.values()))[0])


def relative_error(score: Mapping[str, Any], cell: str, name: str) -> float:
    """Root mean square error of the offsets over theirs: 1 is SMPL alone's, 0 none."""
    return float(np.sqrt(max(1 - score["cells"][cell][name]["r2"], 0.0)))


def _draw_cost(path: Path, of: Mapping[str, Scores]) -> None:
    figure = new_figure(5.2 * len(of), 4.4, title="Size against error on what is new",
                        origin="synthetic")  # fmt: skip
    cell = list(CELLS)[-1]
    for axis, (corpus, scores) in zip(
        figure.subplots(1, len(of), squeeze=False)[0], of.items(), strict=True
    ):
        entries = scores[0]["systems"]
        sized = [n for n in systems_of(scores) if entries.get(n, {}).get("parameters")]
        for name in sized:
            error = mean(relative_error(score, cell, name) for score in scores)
            _point(axis, scores[0], name, float(np.clip(error, _LEAST, _MOST)))
        best = mean(relative_error(score, cell, BEST) for score in scores)
        axis.axhline(best, color=_PLUS, label="DSNet+ (no network)")
        axis.axhline(1, color="grey", linestyle=":", label="SMPL alone")
        axis.set(xscale="log", yscale="log", title=corpus, xlabel="parameters", xlim=(4e4, 2e6))
        axis.set_ylabel("error over size of the offsets")
        handles = dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True))
        # Between what is worse than SMPL alone, above, and the line of DSNet+, below.
        axis.legend(
            handles.values(), handles.keys(), fontsize=7, loc="lower left", bbox_to_anchor=(0, 0.1)
        )
    save_figure(figure, path)


def _point(axis: Axes, score: Mapping[str, Any], name: str, error: float) -> None:
    """Variants of DSNet by colour, for their names would cover each other; others by name."""
    size = score["systems"][name]["parameters"]
    if not name.startswith("dsnet_"):
        axis.plot(size, error, "s", color="black", markersize=5)
        label = score["labels"][name].partition(",")[0]
        axis.annotate(label, (size, error), (6, -3), fontsize=8, textcoords="offset points")
        return
    change = score["systems"][name]["code"] == "pca"
    label, colour = ("DSNet, changed", _NEW) if change else ("DSNet", _KNOWN)
    axis.plot(size, error, "o", color=colour, label=label)


def _draw_cells(path: Path, of: Mapping[str, Scores]) -> None:
    """Known and new people in two colours, known and unseen motions in two columns (Figure 9)."""
    tallest = max(len(systems_of(scores)) for scores in of.values())
    figure = new_figure(9.5, len(of) * (0.26 * tallest + 1.2), title="Error in each cell",
                        origin="synthetic")  # fmt: skip
    axes = figure.subplots(len(of), 2, squeeze=False, sharex=True)
    for row, (corpus, scores) in zip(axes, of.items(), strict=True):
        for axis, motion in zip(row, ("known", "unseen"), strict=True):
            _bars(axis, scores, motion)
            axis.set_title(f"{corpus}: {motion} motions", fontsize=9)
        row[1].set_yticklabels([])
    for axis in axes[-1]:
        axis.set_xlabel("error over size of the offsets")
    axes[0, 0].legend(fontsize=7)
    save_figure(figure, path)


def _bars(axis: Axes, scores: Scores, motion: str) -> None:
    names = systems_of(scores)[::-1]
    for shift, person, colour in ((0.2, "known", _KNOWN), (-0.2, "new", _NEW)):
        cell = f"{person}_person_{motion}_motion"
        errors = [mean(relative_error(s, cell, name) for s in scores) for name in names]
        axis.barh(np.arange(len(names)) + shift, np.clip(errors, _LEAST, _MOST) - _LEAST, 0.4,
                  left=_LEAST, color=colour, label=f"{person} people")  # fmt: skip
    axis.set_yticks(range(len(names)), [scores[0]["labels"].get(n, n) for n in names], fontsize=6.5)
    axis.axvline(1, color="black", linestyle=":", linewidth=0.8)
    axis.set_xscale("log")


def _draw_over_time(path: Path, score: Mapping[str, Any]) -> None:
    """One panel a system, the truth behind it, all on one scale."""
    shown = score["over_time"]["mm"]
    names = [name for name in systems_of([score]) if name in shown and name not in NOTHING]
    columns = 3
    rows = -(-len(names) // columns)
    title = f"Size of the offsets over time, {score['over_time']['sequence']} (new to all)"
    figure = new_figure(10, 1.5 * rows + 0.8, title=title, origin="synthetic")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    true = np.array(shown["true"])
    for axis, name in zip(axes.flat, names, strict=False):
        seconds = np.arange(len(true)) / FPS
        axis.fill_between(seconds, true, color="lightgrey")
        axis.plot(seconds, shown[name], color=_PLUS if name == BEST else _NEW, linewidth=0.9)
        axis.set_title(score["labels"][name], fontsize=7.5)
        axis.set_ylim(0, 1.6 * true.max())
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    axes[-1, columns // 2].set_xlabel("time [s]; grey: the truth", fontsize=8)
    figure.supylabel("mean over vertices [mm]", fontsize=8)
    save_figure(figure, path)
