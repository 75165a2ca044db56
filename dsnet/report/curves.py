"""Figures 6, 8 and 10 of the paper, losses, and the size and spectrum of offsets over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from bridge.exchange.dsnet import LITERAL_DSNETS
from bridge.motion import sequences_of
from bridge.paper import CLIP_FRAMES
from bridge.runs import Artifact
from bridge.runs.artifact import DataOrigin
from dsnet.evaluation.comparison import TRUE
from dsnet.evaluation.evaluation import MESH_ERROR, OFFSET_SIZE, per_frame_m
from dsnet.evaluation.metrics import BIN_HZ
from dsnet.evaluation.pipelines import SMPL, SUBJECT_MEAN
from dsnet.pictures.panels import new_figure, save_figure

# Okabe and Ito's colours are safe for colour-blind readers; line styles help in print.
_TRAINED = ("#0072B2", "#56B4E9", "#CC79A7", "#009E73", "#D55E00", "#F0E442")
_LINES = ("-", "-.", ":")
_UNTRAINED = {SUBJECT_MEAN: ("#E69F00", "--"), SMPL: ("#777777", "-")}
_TRUE_STYLE = ("#000000", "-")
TRUE_POSE = "true pose"
_ALIGNED = ("#D55E00", "#0072B2", "#009E73")
_LOSSES = {"training": ("#0072B2", "-"), "validation": ("#D55E00", "--")}
Curves = Mapping[str, tuple[NDArray, NDArray]]
"""x and y values of each curve, by label."""


@contextmanager
def _drawn_axes(
    path: Path, title: str, origin: DataOrigin, x: str, y: str, *, legend: bool = True
) -> Iterator[Axes]:
    """Axes of a new figure, which is written to `path` when the block ends."""
    figure = new_figure(8.0, 3.9, title=title, origin=origin)
    axes = figure.subplots()
    yield axes
    finish_axes(axes, x, y, legend=legend)
    save_figure(figure, path)


def finish_axes(axes: Axes, x: str, y: str, *, legend: bool = True) -> None:
    """Label axes and give them the look that all curves of the report share."""
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, linewidth=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if legend:
        axes.legend(fontsize=8, frameon=False)


def draw_figure6(path: Path, align: Artifact) -> None:
    """Figure 6: histogram of sequence lengths, and the clip length they are padded or cut to."""
    lengths = [sequence.length for sequence in sequences_of(align)]
    title = "Figure 6: lengths of the sequences"
    with _drawn_axes(path, title, align.origin, "frames", "sequences", legend=False) as axes:
        edges = np.arange(0, max(*lengths, CLIP_FRAMES) + 100, 50)
        axes.hist(lengths, bins=edges.tolist(), color="#0072B2", edgecolor="white")
        axes.axvline(CLIP_FRAMES, color="#D55E00", linestyle="--")
        place = {"transform": axes.get_xaxis_transform(), "va": "top", "fontsize": 9}
        axes.text(CLIP_FRAMES, 0.98, f" {CLIP_FRAMES} frames", color="#D55E00", **place)
        axes.set_xlim(left=0)
        axes.margins(y=0.15)  # room for the label above the bars
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))


def draw_figure8(path: Path, evaluate: Artifact, sequence: Mapping[str, Any]) -> None:
    """Figure 8: error of the posed mesh in each frame; the default predictor is drawn on top."""
    title = f"Figure 8: error over time, {sequence['name']} (never trained on)"
    styles = dict(reversed((trained_styles(evaluate) | _UNTRAINED).items()))
    _draw_over_time(path, evaluate, MESH_ERROR, sequence, styles, title, "mean vertex error [mm]")


def draw_figure10(
    path: Path, turns: Mapping[str, NDArray], *, fps: float, title: str, origin: DataOrigin
) -> None:
    """Figure 10: rotation vectors (T, 3) of one joint over time, radians, by label.

    The one labelled `TRUE_POSE` is drawn as a broad line below the others, so that it stays
    visible where they coincide.
    """
    figure = new_figure(8.0, 5.4, title=title, origin=origin)
    for component, axes in enumerate(figure.subplots(3, 1, sharex=True, sharey=True)):
        colours = zip(cycle(_ALIGNED), cycle(_LINES), strict=False)
        for label, turn in turns.items():
            degrees, times_s = np.degrees(turn[:, component]), np.arange(len(turn)) / fps
            if label == TRUE_POSE:
                axes.plot(times_s, degrees, color="#999999", linewidth=5, alpha=0.6, label=label)
                continue
            colour, line = next(colours)
            axes.plot(times_s, degrees, line, color=colour, linewidth=1.3, label=label)
        finish_axes(axes, "", f"{'xyz'[component]} [deg]", legend=False)
    first, *_, last = figure.get_axes()
    first.legend(fontsize=8, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    last.set_xlabel("time [s]", fontsize=9)
    save_figure(figure, path)


def draw_offset_size(path: Path, evaluate: Artifact, sequence: Mapping[str, Any]) -> None:
    """Draw the mean length of the moving offsets in each frame."""
    title = f"Size of the skin offsets over time, {sequence['name']} (never trained on)"
    styles = {TRUE: _TRUE_STYLE} | trained_styles(evaluate)
    _draw_over_time(path, evaluate, OFFSET_SIZE, sequence, styles, title, "mean over vertices [mm]")


def _draw_over_time(
    path: Path,
    evaluate: Artifact,
    kind: str,
    sequence: Mapping[str, Any],
    styles: Mapping[str, tuple[str, str]],
    title: str,
    y: str,
) -> None:
    fps = next(s.fps for s in sequences_of(evaluate) if s.name == sequence["name"])
    read = {name: per_frame_m(evaluate, kind, name, sequence["name"]) for name in styles}
    curves_mm = {name: 1e3 * curve_m for name, curve_m in read.items() if curve_m is not None}
    # An untrained autoencoder's errors would press all others to the ground.
    usual = [curve.max() for n, curve in curves_mm.items() if n not in LITERAL_DSNETS.values()]
    top_mm = 1.5 * (max(usual, default=0.0) or 1.0)
    with _drawn_axes(path, title, evaluate.origin, "time [s]", y, legend=False) as axes:
        for name, curve_mm in curves_mm.items():
            colour, line = styles[name]
            label = evaluate.manifest["predictors"].get(name, "true")
            label += f", mean {curve_mm.mean():.2f} mm"
            label += " (above)" if curve_mm.min() > top_mm else ""
            times_s = np.arange(len(curve_mm)) / fps
            axes.plot(times_s, curve_mm, line, color=colour, label=label, linewidth=1.5)
        axes.set_ylim(bottom=0.0, top=top_mm)
        axes.set_xlim(0, sequence["frames"] / fps)
        # Above, as the curves take all of the room.
        axes.legend(fontsize=8, frameon=False, ncols=2, loc="lower left", bbox_to_anchor=(0, 1))


def liveliest_sequence(evaluate: Artifact) -> dict[str, Any] | None:
    """The test sequence whose true offsets change fastest; None if no velocity was measured."""
    default = evaluate.manifest["default"]
    tested = [
        one
        for one in evaluate.manifest["per_sequence"]
        if one["split"] == "test" and "velocity" in one["errors"].get(default, {})
    ]
    speeds = [one["errors"][default]["velocity"]["true_rms_mm_s"] for one in tested]
    return tested[int(np.argmax(speeds))] if tested else None


def draw_spectrum(path: Path, evaluate: Artifact) -> None:
    """Draw the root mean square of the moving offsets by frequency, over all test sequences."""
    arrays, labels = evaluate.manifest["arrays"], evaluate.manifest["predictors"]
    styles = trained_styles(evaluate)
    drawn = {n: evaluate.array(f"spectrum_{n}") for n in styles if f"spectrum_{n}" in arrays}
    true_mm = next(iter(drawn.values()))[0]
    frequencies_hz = BIN_HZ * (np.arange(len(true_mm)) + 0.5)
    floor_mm = 1e-4 * float(true_mm.max()) or 1e-9
    curves = [("true", true_mm, _TRUE_STYLE, 2.0)]
    curves += [(labels[name], sizes_mm[1], styles[name], 1.5) for name, sizes_mm in drawn.items()]
    title, y = "Spectrum of the skin offsets", "root mean square in half a hertz [mm]"
    with _drawn_axes(path, title, evaluate.origin, "frequency [Hz]", y) as axes:
        for label, size_mm, (colour, line), width in curves:
            shown_mm = np.maximum(size_mm, floor_mm)
            axes.plot(frequencies_hz, shown_mm, line, color=colour, label=label, linewidth=width)
        axes.set_yscale("log")
        axes.set_xlim(0, frequencies_hz[-1])


def trained_styles(evaluate: Artifact) -> dict[str, tuple[str, str]]:
    """Colour and line of each trained predictor, in the order of the tables."""
    pipelines = evaluate.manifest["pipelines"].values()
    trained = {name for pipeline in pipelines for name in pipeline["predictors"]}
    names = [name for name in evaluate.manifest["predictors"] if name in trained]
    return dict(zip(names, zip(cycle(_TRAINED), cycle(_LINES), strict=False), strict=False))


def draw_autoencoder_loss(path: Path, train_ae: Artifact) -> None:
    """Draw the autoencoder's losses; the validation loss starts before the first step."""
    loss, validation, steps = (
        np.asarray(train_ae.array(name)) for name in ("loss", "validation_loss", "validation_steps")
    )
    curves = {"training": (steps[1:], loss), "validation": (steps, validation)}
    title, y = "Loss of the autoencoder (mean squared error)", "loss of normalised offsets"
    _draw_losses(path, title, train_ae.origin, {"": curves}, "step", y)


def draw_predictor_losses(path: Path, title: str, x: str, y: str, trained: Artifact) -> None:
    """Draw the losses of each predictor that has any, on separate axes as their units differ."""
    arrays = trained.manifest["arrays"]
    panels: dict[str, dict[str, tuple[NDArray, NDArray]]] = {}
    for name, one in trained.manifest["predictors"].items():
        if f"loss_{name}" in arrays:
            loss = trained.array(f"loss_{name}")
            panel = one["label"] + (f", Adam {one['lr']:g}" if "lr" in one else "")
            panels[panel] = {"training": (1 + np.arange(len(loss)), loss)}
            if (epochs := f"validation_epochs_{name}") in arrays:
                curve = trained.array(epochs), trained.array(f"validation_loss_{name}")
                panels[panel]["validation"] = curve
    _draw_losses(path, title, trained.origin, panels, x, y)


def _draw_losses(
    path: Path, title: str, origin: DataOrigin, panels: Mapping[str, Curves], x: str, y: str
) -> None:
    """Draw one panel per title, two in a row, on a logarithmic scale where losses fall far."""
    rows = (len(panels) + 1) // 2
    width_in = 6.5 if len(panels) == 1 else 8.8
    figure = new_figure(width_in, 3.6 if rows == 1 else 2.9 * rows, title=title, origin=origin)
    grid = [*figure.subplots(rows, min(len(panels), 2), squeeze=False).flat]
    for unused in grid[len(panels) :]:
        unused.remove()
    for axes, (panel, curves) in zip(grid, panels.items(), strict=False):
        for label, (steps, values) in curves.items():
            colour, line = _LOSSES[label]
            marker = "o" if len(steps) < 20 else ""
            axes.plot(steps, values, line, marker=marker, color=colour, label=label, linewidth=1.2)
        values = np.concatenate([values for _, values in curves.values()])
        if (values > 0).all() and 10 * values.min() < values.max() < np.inf:
            axes.set_yscale("log")
        axes.set_title(panel, fontsize=9)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        finish_axes(axes, x, y)
    save_figure(figure, path)
