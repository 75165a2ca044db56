"""How offsets move, as curves: their size over time and their spectrum, predicted and true."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bridge.measure.spectrum import STEP_HZ
from bridge.measure.stage_evaluate import TRUE, offset_sizes_m
from bridge.report.curve_figures import finish_axes, trained_styles
from bridge.report.panels import new_figure, save_figure
from bridge.runs import Artifact

_TRUE_LABEL = "true"


def stopping_sequence(evaluate: Artifact) -> dict[str, Any] | None:
    """The measured test sequence whose flesh swings most after a stop, or the first; or None."""
    default = evaluate.manifest["default"]
    tested = [
        one
        for one in evaluate.manifest["per_sequence"]
        if one["split"] == "test" and "velocity" in one["errors"].get(default, {})
    ]
    return max(tested, key=lambda one: _swing_mm(one["errors"][default]), default=None)


def draw_offset_size(path: Path, evaluate: Artifact, sequence: dict[str, Any]) -> None:
    """Mean length of the moving offsets in each frame; shaded where the body stands still."""
    name = sequence["name"]
    title = f"Size of the skin offsets over time, {name} (never trained on)"
    figure = new_figure(8.0, 3.9, title=title, origin=evaluate.origin)
    axes = figure.subplots()
    fps = next(one["fps"] for one in evaluate.manifest["sequences"] if one["name"] == name)
    curves = {TRUE: ("#000000", "-")} | trained_styles(evaluate)
    for predictor, (colour, line) in curves.items():
        size_m = offset_sizes_m(evaluate, predictor, name)
        if size_m is not None:
            label = evaluate.manifest["predictors"].get(predictor, _TRUE_LABEL)
            times_s = np.arange(len(size_m)) / fps
            axes.plot(times_s, 1e3 * size_m, line, color=colour, label=label, linewidth=1.5)
    for start_s, stop_s in sequence["stands_still_s"]:
        axes.axvspan(start_s, stop_s, color="#000000", alpha=0.07, linewidth=0)
    axes.set_xlim(0, sequence["frames"] / fps)
    axes.set_ylim(bottom=0.0, top=1.3 * axes.get_ylim()[1])  # room for the legend
    finish_axes(axes, "time [s]", "mean over vertices [mm]")
    save_figure(figure, path)


def draw_spectrum(path: Path, evaluate: Artifact) -> None:
    """Root mean square of the moving offsets in each half hertz, over all test sequences."""
    figure = new_figure(8.0, 3.9, title="Spectrum of the skin offsets", origin=evaluate.origin)
    axes = figure.subplots()
    drawn = {
        name: evaluate.array(f"spectrum_{name}")
        for name in trained_styles(evaluate)
        if f"spectrum_{name}" in evaluate.manifest["arrays"]
    }
    true_mm = next(iter(drawn.values()))[0]
    frequencies_hz = STEP_HZ * (np.arange(len(true_mm)) + 0.5)
    floor_mm = 1e-4 * float(true_mm.max()) or 1e-9
    axes.plot(
        frequencies_hz,
        np.maximum(true_mm, floor_mm),
        color="#000000",
        label=_TRUE_LABEL,
        linewidth=2,
    )
    for name, (colour, line) in trained_styles(evaluate).items():
        if name in drawn:
            label = evaluate.manifest["predictors"][name]
            shown_mm = np.maximum(drawn[name][1], floor_mm)
            axes.plot(frequencies_hz, shown_mm, line, color=colour, label=label, linewidth=1.5)
    axes.set_yscale("log")
    axes.set_xlim(0, frequencies_hz[-1])
    finish_axes(axes, "frequency [Hz]", "root mean square in half a hertz [mm]")
    save_figure(figure, path)


def _swing_mm(errors: dict[str, Any]) -> float:
    return errors["decay"]["true_mm"] if errors["decay"] else 0.0
